"""Facts as hypothesis draws them."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from modalmotion import Facts
from modalmotion.mesh import WORDS

_LETTERS = st.characters(categories=["Lu", "Ll", "Lo", "Nd", "Pd", "Sc"])

WORD = st.text(_LETTERS, min_size=1, max_size=12)

COORDINATE = st.floats(allow_nan=False, allow_infinity=False)
PLACE = st.integers(0, 3) | st.tuples(COORDINATE, COORDINATE, COORDINATE)


def facts_of(**values: Any) -> Facts:
    """Facts of values that may have the wrong type."""
    return Facts(**values)


def _names(values: st.SearchStrategy[Any]) -> st.SearchStrategy[dict[str, Any]]:
    # By casefold, for names that differ in capitals alone are refused.
    pairs = st.lists(st.tuples(WORD, values), max_size=4, unique_by=lambda pair: pair[0].casefold())
    return pairs.map(dict)


@st.composite
def _facts(draw: st.DrawFn) -> Facts:
    words = {name: draw(st.sampled_from(options)) for name, options in WORDS.items()}
    if words["coordinates"] != "unknown" and words["handedness"] == "left":
        words["handedness"] = "right"
    landmarks = draw(_names(PLACE))
    landmarks.pop("corners", None)
    if draw(st.booleans()):
        landmarks["corners"] = tuple(draw(PLACE) for _ in range(4))
    return facts_of(
        **words,
        period=draw(st.none() | st.floats(1.0, 1e9)),
        modality=draw(st.none() | WORD),
        landmarks=landmarks,
        covariates=draw(_names(COORDINATE | st.integers(-(2**60), 2**60) | WORD)),
    )


FACTS = _facts()
"""Any facts of a sequence of at least four vertices whose times span a second at most."""
