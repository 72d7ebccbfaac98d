"""Facts: statements of the sender that the arrays of a sequence cannot hold."""

import math
import operator
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from numbers import Real
from typing import Any, Final, Literal, TypeAlias, get_args

from modalmotion.errors import ParameterError
from modalmotion.representation import is_readable

Place: TypeAlias = int | tuple[float, float, float]
"""A vertex by its number, or a point in the coordinates of the reference frame."""

Corners: TypeAlias = tuple[Place, Place, Place, Place]
"""Of a plane: (s, t) = (0, 0), (1, 0), (1, 1), (0, 1), in this order."""

CORNERS: Final = "corners"
"""The landmark that is four places."""

_VERTEX: Final = re.compile(r"[0-9]{1,15}")
_LAST_VERTEX: Final = 10**15 - 1


def landmark_of(name: str, value: Any) -> Place | Corners:
    """Check a landmark: one place, or the four corners of a plane.

    Raises
    ------
    ParameterError
        If it is neither a vertex nor a point; it names the landmark.
    """
    if name != CORNERS:
        return _place(name, value)
    parts = _parts(value)
    if len(parts) != 4:
        raise ParameterError(
            f"The landmark 'corners' has {len(parts)} places, not four.",
            remedy="Give the corners at (s, t) = (0, 0), (1, 0), (1, 1), (0, 1).",
            details={"fact": "landmarks"},
        )
    a, b, c, d = (_place(name, part) for part in parts)
    return a, b, c, d


def read_place(text: str, name: str = "landmark") -> Place:
    """Read a place: the number of a vertex, or a point such as "1.5,0,-3".

    Raises
    ------
    ParameterError
        If it is neither.
    """
    if _VERTEX.fullmatch(text.strip()):
        return int(text)
    return _place(name, text.split(","))


def read_landmark(text: str, name: str) -> Place | Corners:
    """Read a landmark as `read_place` does; corners are parted by semicolons.

    Raises
    ------
    ParameterError
        If it is not a landmark.
    """
    if name != CORNERS:
        return read_place(text, name)
    return landmark_of(name, [read_place(part, name) for part in text.split(";")])


def _place(name: str, value: Any) -> Place:
    if not isinstance(value, bool | float | str):
        try:
            number = operator.index(value)
        except TypeError:
            pass
        else:
            if 0 <= number <= _LAST_VERTEX:
                return number
            raise _no_place(name)
    parts = _parts(value)
    if len(parts) != 3 or any(isinstance(part, bool) for part in parts):
        raise _no_place(name)
    try:
        x, y, z = (float(part) for part in parts)
    except (TypeError, ValueError, OverflowError):
        raise _no_place(name) from None
    if not all(map(math.isfinite, (x, y, z))):
        raise _no_place(name)
    return x, y, z


def _parts(value: Any) -> list[Any]:
    return list(value) if isinstance(value, Iterable) and not isinstance(value, str) else []


def _no_place(name: str) -> ParameterError:
    return ParameterError(
        f"The landmark '{name[:64]}' is neither a vertex nor a point.",
        remedy="Give the number of a vertex, counted from 0, or three finite coordinates x, y, z "
        "in the unit of the sequence.",
        details={"fact": "landmarks"},
    )


Tracking: TypeAlias = Literal["material", "normal_displacement", "unknown"]
Handedness: TypeAlias = Literal["right", "left", "unknown"]
CoordinateSystem: TypeAlias = Literal["LPS", "RAS", "unknown"]
Cavity: TypeAlias = Literal["lv", "rv", "la", "ra", "other", "none", "unknown"]

UNKNOWN: Final = "unknown"

WORDS: Final[Mapping[str, tuple[str, ...]]] = {
    "tracking": get_args(Tracking),
    "handedness": get_args(Handedness),
    "coordinates": get_args(CoordinateSystem),
    "cavity": get_args(Cavity),
}
"""Facts that are one of a few words, and the words."""

MOST_LANDMARKS: Final = 100
MOST_COVARIATES: Final = 100
LONGEST_NAME: Final = 64
LONGEST_WORD: Final = 200
LONGEST_MODALITY: Final = 40

# Share by which a period may fall short of the times: both may have been rounded.
_ROUNDED: Final = 1e-6

# Whole numbers up to here are the same as float64.
_EXACT: Final = 2.0**53


@dataclass(frozen=True, repr=False)
class Facts:
    """Statements of the sender about a sequence beside its arrays; all may be unknown.

    Not part of the sequence's id: correcting a fact leaves the arrays as they are. A result that
    reads a fact has it in its key.

    Parameters
    ----------
    tracking : {"material", "normal_displacement", "unknown"}
        Whether vertices follow tissue, or slide over it along the surface's normals.
    handedness : {"right", "left", "unknown"}
        Handedness of the coordinate system.
    coordinates : {"LPS", "RAS", "unknown"}
        Directions of x, y and z in a patient. Both are right-handed.
    period : float or None, s
        Period of a cycle, such as a heartbeat; at least as long as the times span.
    cavity : {"lv", "rv", "la", "ra", "other", "none", "unknown"}
        The enclosed cavity: a ventricle or an atrium, left or right.
    modality : str or None
        How it was recorded: MR, CT, US, simulated.
    landmarks : mapping of str to (int, (x, y, z) or four of these)
        Named places: a vertex by its number, or a point in the coordinates of the reference
        frame. apex, base, theta_zero and corners place the natural coordinates.
    covariates : mapping of str to (float or str)
        Other knowledge, such as an age: a number or a word for each name.

    Raises
    ------
    ParameterError
        If one is out of range or two contradict each other; it names them.
    """

    tracking: Tracking = UNKNOWN
    handedness: Handedness = UNKNOWN
    coordinates: CoordinateSystem = UNKNOWN
    period: float | None = None
    cavity: Cavity = UNKNOWN
    modality: str | None = None
    landmarks: Mapping[str, Place | Corners] = field(default_factory=dict)
    covariates: Mapping[str, float | str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, words in WORDS.items():
            if getattr(self, name) not in words:
                raise ParameterError(
                    f"The fact '{name}' is {str(getattr(self, name))[:40]!r}.",
                    remedy=f"Use one of {', '.join(words)}.",
                    details={"fact": name},
                )
        if self.handedness == "left" and self.coordinates != UNKNOWN:
            raise ParameterError(
                f"The handedness 'left' contradicts the coordinates '{self.coordinates}', which "
                "are right-handed by definition.",
                remedy="State handedness right, or coordinates unknown.",
                details={"fact": "handedness", "contradicts": "coordinates"},
            )
        checked = {
            "period": None if self.period is None else _period(self.period),
            "modality": _modality(self.modality),
            "landmarks": _named("landmark", self.landmarks, MOST_LANDMARKS, landmark_of),
            "covariates": _named("covariate", self.covariates, MOST_COVARIATES, _covariate),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        # Names and counts: covariates may say who a person is.
        said = [str(getattr(self, name)) for name in self.stated if name in (*WORDS, "modality")]
        if self.period is not None:
            said.append(f"period {self.period:g} s")
        counts = {name: len(getattr(self, name)) for name in ("landmarks", "covariates")}
        said += [f"{n} {name[:-1] if n == 1 else name}" for name, n in counts.items() if n]
        return f"Facts({', '.join(said) or UNKNOWN})"

    @property
    def stated(self) -> tuple[str, ...]:
        """Names of the known facts."""
        return self.changed(NO_FACTS)

    def changed(self, other: "Facts") -> tuple[str, ...]:
        """Names of the facts in which two differ."""
        if self == other:
            return ()
        return tuple(name for name in NAMES if getattr(self, name) != getattr(other, name))

    def over(self, other: "Facts") -> "Facts":
        """Override another's facts with these; landmarks and covariates by name.

        Raises
        ------
        ParameterError
            If the two together contradict each other.
        """
        stated = {name: getattr(self, name) for name in self.stated}
        for name in ("landmarks", "covariates"):
            if name in stated:
                stated[name] = {**getattr(other, name), **stated[name]}
        return replace(other, **stated) if stated else other

    def require_fit(self, n_vertices: int, span: float | None) -> None:
        """Check the facts against the arrays of their sequence.

        Parameters
        ----------
        n_vertices : int
        span : float or None, s
            From the first time to the last; None if times are unknown.

        Raises
        ------
        ParameterError
            If a landmark is a vertex that does not exist, or the period is shorter than the span.
        """
        for name, value in self.landmarks.items():
            for vertex in value if name == CORNERS and isinstance(value, tuple) else (value,):
                require_vertex(name, vertex, n_vertices)
        if self.period is not None and span is not None and self.period < span * (1 - _ROUNDED):
            raise ParameterError(
                f"The period is {self.period:g} s, but the times span {span:g} s: it would end "
                "before the recording does.",
                remedy=f"State a period of at least {span!r} s or none, or correct the times, "
                "which are in seconds.",
                details={"fact": "period", "contradicts": "times"},
            )


def require_vertex(name: str, place: object, n_vertices: int) -> None:
    """Check that the vertex that a landmark names, if it names one, exists.

    Raises
    ------
    ParameterError
    """
    if isinstance(place, int) and place >= n_vertices:
        raise ParameterError(
            f"The landmark '{name}' is vertex {place}, but there are {n_vertices} "
            f"(0 to {n_vertices - 1}).",
            remedy="Name a vertex of the sequence, counted from 0, or give a point x, y, z.",
            vertex=place,
            details={"fact": "landmarks"},
        )


NAMES: Final = tuple(f.name for f in fields(Facts))
"""All facts, in their order."""


def _finite(value: Any) -> float | None:
    """Return a finite real number, and None of anything else."""
    if not isinstance(value, Real) or isinstance(value, bool):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _period(value: Any) -> float:
    period = _finite(value)
    if period is not None and period > 0:
        return period
    raise ParameterError(
        f"The period is {str(value)[:40]!r}.",
        remedy="Use a finite number of seconds above zero, or leave it out.",
        details={"fact": "period"},
    )


def _modality(value: Any) -> str | None:
    if value is None:
        return None
    if isinstance(value, str) and _is_plain(value, LONGEST_MODALITY):
        return value
    raise ParameterError(
        f"The modality is {str(value)[:40]!r}.",
        remedy=f"Use a word of at most {LONGEST_MODALITY} characters, such as MR, CT, US or "
        "simulated, or leave it out.",
        details={"fact": "modality"},
    )


def _covariate(name: str, value: Any) -> float | str:
    # The value is left out: messages reach logs.
    if isinstance(value, str) and _is_plain(value, LONGEST_WORD):
        return value
    if (number := _finite(value)) is not None:
        # One form for each number: 61 and 61.0 are written alike.
        return int(number) if number.is_integer() and abs(number) < _EXACT else number
    raise ParameterError(
        f"The covariate '{name}' is neither a finite number nor a short word.",
        remedy=f"Give a finite number, or a word of 1 to {LONGEST_WORD} printable characters; "
        "leave out what is missing.",
        details={"fact": "covariates", "name": name},
    )


def _named(kind: str, values: Any, most: int, check: Any) -> dict[str, Any]:
    if isinstance(values, Mapping):
        values = values.items()
    pairs = list(values) if isinstance(values, Iterable) and not isinstance(values, str) else None
    if pairs is None or any(not isinstance(p, tuple) or len(p) != 2 for p in pairs):
        raise ParameterError(
            f"The {kind}s are {str(values)[:40]!r}.",
            remedy=f"Give a mapping from the name of each {kind} to its value.",
            details={"fact": f"{kind}s"},
        )
    if len(pairs) > most:
        raise ParameterError(
            f"There are {len(pairs)} {kind}s, more than {most}.",
            remedy=f"State at most {most}.",
            details={"fact": f"{kind}s", "most": most},
        )
    known: dict[str, str] = {}
    for name, _ in pairs:
        require_fact_name(kind, name)
        if name.casefold() in known:
            raise stated_twice(kind, name, known[name.casefold()])
        known[name.casefold()] = name
    return dict(sorted((name, check(name, value)) for name, value in pairs))


def require_fact_name(kind: str, name: Any) -> None:
    """Check the name of a landmark or a covariate.

    Raises
    ------
    ParameterError
        If it is too long, or cannot be in a heading or before an "=".
    """
    if not isinstance(name, str) or not _is_plain(name, LONGEST_NAME) or set("=:;,") & set(name):
        raise ParameterError(
            f"The name {str(name)[:40]!r} of a {kind} cannot be stored.",
            remedy=f"Use 1 to {LONGEST_NAME} printable characters without blanks at the ends "
            "and without = : ; and comma.",
            details={"fact": f"{kind}s"},
        )


def stated_twice(kind: str, name: str, other: str) -> ParameterError:
    """Error for a landmark or covariate that is named twice, maybe in capitals once."""
    how = "" if name == other else f" (once as '{other[:LONGEST_NAME]}')"
    return ParameterError(
        f"The {kind} '{name[:LONGEST_NAME]}' is stated twice{how}.",
        remedy="State it once.",
        details={"fact": f"{kind}s", "name": name[:LONGEST_NAME]},
    )


def _is_plain(text: str, longest: int) -> bool:
    is_shown = text.isprintable() and is_readable(text)
    return is_shown and 0 < len(text) <= longest and text == text.strip()


NO_FACTS: Final = Facts()
"""Facts of a sequence without statements."""
