"""Members of a model, and how they read, as arrays and texts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.estimators.scorer import Blend, Scorer
from modalmotion.classification.features import (
    Column,
    CovariateColumn,
    FeatureReader,
    Further,
)
from modalmotion.classification.features.patterns import LENGTH, Patterns
from modalmotion.classification.model.member import Member
from modalmotion.classification.options import MOST_HARMONICS
from modalmotion.hdf5.contents import Contents

_FLAGS: Final = ("has_axis", "is_cycle", "walls", "adds_modes", "is_brief", "reads_motion")


def member_arrays(members: Sequence[Member], n_classes: int) -> dict[str, NDArray[Any]]:
    """Take members to pieces, but for their readers and columns.

    They have features of their own: their arrays follow one another, row by row.
    """
    scorers = [scorer for member in members for scorer in member.blend.scorers]
    patterns = [p for m in members if (p := m.reader.patterns) is not None]
    # A model without patterns has no place for them.
    found = {"patterns": joined([a for p in patterns for a in p.arrays])} if patterns else {}
    return {
        **found,
        "typical": joined([t for m in members if (t := m.reader.typical) is not None]),
        "centre": np.concatenate([m.blend.centre for m in members]),
        "scale": np.concatenate([m.blend.scale for m in members]),
        "n_scorers": np.array([len(m.blend.scorers) for m in members], dtype=np.int64),
        "n_anchors": np.array([len(s.anchors) for s in scorers], dtype=np.int64),
        "anchors": joined([s.anchors for s in scorers]),
        "gammas": np.array([s.gamma for s in scorers], dtype=np.float64),
        "weights": joined([s.weights for s in scorers]),
        "intercepts": np.array([s.intercepts for s in scorers]).reshape(-1, n_classes),
        "scorer_temperatures": np.array([s.temperature for s in scorers], dtype=np.float64),
        "temperatures": np.array([m.blend.temperature for m in members], dtype=np.float64),
        "member_weights": np.array([m.weight for m in members], dtype=np.float64),
        "machine": np.frombuffer(members[0].machine, dtype=np.uint8),
    }


def reader_texts(reader: FeatureReader) -> dict[str, Any]:
    """Give a reader as JSON values, but for its typical motion."""
    return {
        **{name: getattr(reader, name) for name in (*_FLAGS, "n_harmonics", "n_modes")},
        "typical": None if reader.typical is None else reader.typical.shape,
        **({} if reader.patterns is None else {"patterns": reader.patterns.pieces.shape[:2]}),
        "further": reader.further,
        "covariates": [[c.name, c.mean, c.words, c.may_be_missing] for c in reader.covariates],
    }


def members_of(contents: Contents, n: int) -> tuple[Member, ...]:
    """Read the members of a model of n classes."""
    readers, columns = contents.json("readers", list), contents.json("columns", list)
    k = len(readers)
    if k < 1 or len(columns) != k:
        raise ValueError("the parts of the model do not fit together")
    n_scorers = contents.array("n_scorers", (k,)).astype(np.int64)
    s = int(n_scorers.sum())
    machine = contents.array("machine", (None,)).astype(np.uint8).tobytes()
    if (n_scorers < 0).any() or any((n_scorers == 0) != bool(machine)) or (machine and k > 1):
        raise ValueError("the parts of the model do not fit together")
    n_anchors = contents.array("n_anchors", (s,)).astype(np.int64).tolist()
    gammas = contents.array("gammas", (s,)).tolist()
    intercepts = contents.array("intercepts", (s, n))
    of_scorers = contents.array("scorer_temperatures", (s,)).tolist()
    temperatures = contents.array("temperatures", (k,)).tolist()
    weights = contents.array("member_weights", (k,)).tolist()
    typical, centre, scale, anchors, coefficients = (
        Values(contents.array(name, (None,)))
        for name in ("typical", "centre", "scale", "anchors", "weights")
    )
    patterns = Values(
        contents.array("patterns", (None,)) if "patterns" in contents.arrays else np.zeros(0)
    )
    members, place = [], 0
    for j in range(k):
        features = tuple(
            Column(str(name), tuple(map(int, modes)), float(power))
            for name, modes, power in columns[j]
        )
        d = len(features)
        # A linear scorer has no anchors, and weighs the features.
        scorers = tuple(
            Scorer(
                anchors=anchors.take(n_anchors[i], d),
                gamma=gammas[i],
                weights=coefficients.take(n_anchors[i] or d, n),
                intercepts=intercepts[i],
                temperature=of_scorers[i],
            )
            for i in range(place, place + int(n_scorers[j]))
        )
        place += int(n_scorers[j])
        blend = Blend(centre.take(d), scale.take(d), scorers, temperatures[j])
        members.append(
            Member(reader_of(readers[j], typical, patterns), features, blend, machine, weights[j])
        )
    for values in (typical, centre, scale, anchors, coefficients, patterns):
        values.require_end()
    return tuple(members)


def reader_of(
    values: dict[str, Any], typical: Values, patterns: Values | None = None
) -> FeatureReader:
    """Read a reader from its texts, and what it has learned from the next of the values."""
    n_harmonics, n_modes = int(values["n_harmonics"]), int(values["n_modes"])
    if not 1 <= n_harmonics <= MOST_HARMONICS or n_modes < 0:
        raise ValueError(f"it reads {n_harmonics} harmonics of {n_modes} modes")
    motion = None
    if values["typical"] is not None:
        real, imaginary = typical.take(2, *map(int, values["typical"]))
        motion = real + 1j * imaginary
    pieces = None
    if values.get("patterns") is not None and patterns is not None:
        n, n_signals = map(int, values["patterns"])
        shapes = ((n, n_signals, LENGTH), (n,), (n,), (n,))
        pieces = Patterns.of_arrays([patterns.take(*shape) for shape in shapes])
    return FeatureReader(
        n_harmonics=n_harmonics,
        n_modes=n_modes,
        typical=motion,
        patterns=pieces,
        further=tuple(Further(kind) for kind in values["further"]),
        covariates=tuple(
            CovariateColumn(str(name), float(mean), tuple(map(str, words)), bool(may_be_missing))
            for name, mean, words, may_be_missing in values["covariates"]
        ),
        **{name: bool(values[name]) for name in _FLAGS},
    )


class Values:
    """Values of several arrays, taken one after another.

    Parameters
    ----------
    values : (values,) float64
    """

    def __init__(self, values: NDArray[np.float64]) -> None:
        self._values = values

    def take(self, *shape: int) -> NDArray[np.float64]:
        """Give the next array.

        Raises
        ------
        ValueError
            If there are too few values.
        """
        n = math.prod(shape)
        if min(shape, default=0) < 0 or n > len(self._values):
            raise ValueError("an array of the model is too short")
        taken, self._values = self._values[:n], self._values[n:]
        return taken.reshape(shape).copy()

    def require_end(self) -> None:
        """Check that nothing is left."""
        if len(self._values):
            raise ValueError("an array of the model is too long")


def joined(arrays: list[NDArray[Any]]) -> NDArray[np.float64]:
    """Values of arrays one after another; of a complex one its real and imaginary parts."""
    flat = [np.stack([a.real, a.imag]) if np.iscomplexobj(a) else a for a in arrays]
    return np.concatenate([np.zeros(0), *(a.ravel() for a in flat)])
