"""The domain of a model: what a recording must be like for the model to know its motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features import FeatureReader
from modalmotion.classification.features.course import MEASURES
from modalmotion.classification.features.twins import TWINS
from modalmotion.classification.model.motion_scale import MotionScale
from modalmotion.representation import shown

CHECKS: Final = ("kind", "place", *TWINS, "gap", "leap", "turns", "class")
"""What is measured of a recording: how far its kind of motion is from every class; how far its
size, shape and amount of motion are from those of any training case; how much it looks like
each of `TWINS`; how it closes, leaps and repeats itself, beyond the training cases; and, where no
class is in its set, how far its kind is from the most probable one."""

OF_CLASS: Final = CHECKS.index("class")

PLACE: Final = ("motion", *MEASURES[:2])
"""Coordinates of a place: amount of motion (log), size and shape."""

COURSE: Final = MEASURES[2:]

# Neighbours among the training cases that a place is measured from.
_N_NEIGHBOURS: Final = 5

# Pairs of a case and a training case that are compared at once, 24 bytes each.
_MOST_PAIRS: Final = 250_000

# Shares of the least motion and smoothness in training that a case must reach; and the highest
# such limits, for cohorts that all move a great deal.
_SHARE_OF_LEAST: Final = 0.5
_LEAST_MOTION: Final = 0.003
_LEAST_SMOOTH: Final = 0.5


class Sights(NamedTuple):
    """Recordings as a domain sees them.

    Parameters
    ----------
    kinds : (cases, readings, columns) float64
        See `kind_of`.
    allowed : (cases, readings) bool
        See `readings_of`.
    signs : (twins, columns) float64
        See `twin_signs`.
    measures : (cases, measures) float64
        See `course.measures`.
    """

    kinds: NDArray[np.float64]
    allowed: NDArray[np.bool_]
    signs: NDArray[np.float64]
    measures: NDArray[np.float64]

    @property
    def places(self) -> NDArray[np.float64]:
        """Coordinates of `PLACE`, (cases, 3) float64."""
        return np.concatenate([self.kinds[:, :1, -1], self.measures[:, : len(PLACE) - 1]], axis=1)

    def of(self, rows: NDArray[np.int64]) -> Sights:
        """Those of some cases."""
        return Sights(self.kinds[rows], self.allowed[rows], self.signs, self.measures[rows])


def sights_of(
    kinds: NDArray[np.float64],
    allowed: NDArray[np.bool_],
    signs: NDArray[np.float64],
    measures: NDArray[np.float64],
) -> Sights:
    """Sights, where all readings about an axis may be one for a reader that has none."""
    if kinds.shape[1] == 1:
        allowed = np.ones((len(kinds), 1), dtype=np.bool_)
    return Sights(kinds, allowed, signs, measures)


class Judgement(NamedTuple):
    """How recordings lie to a domain.

    Parameters
    ----------
    readings : (cases,) int64
        Nearest to a class.
    scores : (cases, checks) float64
        Of `CHECKS`: the larger the stranger. No class is named yet: see `of_classes`.
    gains : (cases, twins) float64
        By how much nearer each twin is than the motion, in squares of the distance; where it is
        not above 0 the motion is no such twin.
    hand : (cases,) float64
        Evidence for the mirror image of the motion, over that for the motion.
    of_classes : (cases, classes) float64
        Distance from each class, over how far its training cases are from it.
    """

    readings: NDArray[np.int64]
    scores: NDArray[np.float64]
    gains: NDArray[np.float64]
    hand: NDArray[np.float64]
    of_classes: NDArray[np.float64]

    def named(self, y: NDArray[np.int64]) -> NDArray[np.float64]:
        """Scores of all `CHECKS`, where the classes (cases,) are named."""
        scores = self.scores.copy()
        scores[:, OF_CLASS] = self.of_classes[np.arange(len(y)), y]
        return scores


@shown()
@dataclass(frozen=True, eq=False)
class Domain:
    """Where the training cases lie.

    It has a reader of its own, so that it does not depend on the features that tell classes apart.

    Parameters
    ----------
    reader : FeatureReader
        Of its columns; without a typical motion.
    means : (classes, columns) float64
        Of what motions are like and how large they are: see `kind_of`.
    whitening : (columns, columns) float64
        |(kind - mean) @ whitening| is the distance in standard deviations within a class
        (Mahalanobis), over the root of the number of columns.
    spreads : (classes,) float64
        RMS distance of each class's training cases from its mean.
    points : (cases, 3) float64
        Places of the training cases; see `PLACE`.
    scales : (3,) float64
        Standard deviations of these within a class; infinite for what is not compared.
    directions : (twins, columns) float64
        Along which kinds and their twins differ most, of unit variance within a class.
    centres : (classes, twins) float64
        Mean of each class along these.
    course : (2, 3) float64
        Mean and standard deviation of `COURSE`.
    limits : (checks,) float64
        Of the scores; infinite for what is not checked.
    least_motion : float
        Deformation, as a share of the surface's size, below which nothing moves.
    least_smooth : float
        Smooth share below which a motion is noise.
    has_unit : bool or None
        Whether sizes are in mm, or in units that nobody knows; None where both occur, so that
        sizes are not compared.
    hand_is_stated : bool
        Whether the training cases state their handedness, so that right-handed ones are known.
    hand_temperature : float
        exp(-hand / temperature) is the likelihood of a motion over that of its mirror image.
    """

    reader: FeatureReader
    means: NDArray[np.float64]
    whitening: NDArray[np.float64]
    spreads: NDArray[np.float64]
    points: NDArray[np.float64]
    scales: NDArray[np.float64]
    directions: NDArray[np.float64]
    centres: NDArray[np.float64]
    course: NDArray[np.float64]
    limits: NDArray[np.float64]
    least_motion: float
    least_smooth: float
    has_unit: bool | None
    hand_is_stated: bool
    hand_temperature: float

    def __post_init__(self) -> None:
        for name in ARRAYS:
            getattr(self, name).setflags(write=False)

    @property
    def limit(self) -> float:
        """Distance from every class beyond which a motion is unlike any of the training."""
        return float(self.limits[0])

    def distance(self, kinds: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance to the nearest class, (cases,) float64, of kinds (cases, columns)."""
        # |W'k - W'm|^2 for all classes at once; |W'k|^2 is the same for all.
        a, (twice, squares) = kinds @ self.whitening, self._white_means
        nearest = np.minimum.reduce(a @ twice + squares, axis=1)
        nearest += np.vecdot(a, a)
        np.maximum(nearest, 0.0, out=nearest)
        distances: NDArray[np.float64] = np.sqrt(nearest, out=nearest)
        return distances

    def distances(self, kinds: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distances to all classes, (cases, classes) float64, of kinds (cases, columns)."""
        apart = (kinds[:, None] - self.means) @ self.whitening
        return np.asarray(np.sqrt(np.einsum("ijk,ijk->ij", apart, apart)))

    @cached_property
    def _white_means(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """-2 times the whitened means, as columns, and their squares."""
        b = self.means @ self.whitening
        return -2.0 * b.T, np.einsum("ij,ij->i", b, b)

    def judge(self, sights: Sights) -> Judgement:
        """Measure what `CHECKS` names of some recordings."""
        apart = self._apart(sights.kinds, sights.allowed)
        readings = apart.argmin(axis=1)
        every = np.arange(len(apart))
        nearest = apart[every, readings]
        # A twin keeps its distance where no column changes.
        twins = np.repeat(nearest[:, None], len(sights.signs), axis=1)
        for k in np.flatnonzero((sights.signs < 0).any(axis=1)).tolist():
            kinds = sights.kinds * sights.signs[k]
            twins[:, k] = self._apart(kinds, sights.allowed).min(axis=1)
        own_kinds = sights.kinds[every, readings]
        along = own_kinds @ self.directions.T
        # Of a twin the sign of its direction is the opposite.
        both = self._beside(np.concatenate([along, -along]))
        own, turned = both[: len(along)], both[len(along) :]
        leaps = (sights.measures[:, len(PLACE) - 1 :] - self.course[0]) / self.course[1]
        scores = np.empty((len(apart), len(CHECKS)))
        scores[:, 0] = nearest
        scores[:, 1] = self.distance_from_places(sights.places)
        scores[:, 2 : 2 + len(TWINS)] = -own
        scores[:, 2 + len(TWINS) : OF_CLASS] = leaps
        scores[:, OF_CLASS] = 0.0
        return Judgement(
            readings=readings,
            scores=_known(scores),
            gains=nearest[:, None] ** 2 - twins**2,
            hand=own[:, 0] ** 2 - turned[:, 0] ** 2,
            of_classes=self.distances(own_kinds) / self.spreads,
        )

    @cached_property
    def _scaled_points(self) -> NDArray[np.float64]:
        return np.asarray(self.points / self.scales)

    @cached_property
    def motion_scale(self) -> MotionScale:
        """How often amounts of motion occur on surfaces of a size and shape."""
        return MotionScale(self._scaled_points, float(self.scales[0]))

    def is_too_large(self, place: NDArray[np.float64]) -> bool:
        """Whether the motion at a place, (3,), would be usual if it were several times smaller."""
        known = np.isfinite(self.limits[CHECKS.index("place")])
        return bool(known and self.motion_scale.exceeds(np.nan_to_num(place / self.scales)))

    def nearby(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Places of the training cases that are nearest in size and shape, (cases, 5, 3)."""
        apart = (places[:, None] - self.points) / self.scales
        apart[:, :, 0] = 0.0
        squares = (np.nan_to_num(apart) ** 2).sum(axis=2)
        nearest = np.argsort(squares, axis=1, kind="stable")[:, :_N_NEIGHBOURS]
        return np.asarray(self.points[nearest])

    def _apart(self, kinds: NDArray[np.float64], allowed: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Distance of each reading, (cases, readings); infinite where it is not allowed."""
        n, n_readings, d = kinds.shape
        apart = self.distance(kinds.reshape(-1, d)).reshape(n, n_readings)
        return np.where(allowed, apart, np.inf)

    def _beside(self, along: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signed distance from the nearest class along each direction, (cases, twins)."""
        apart = along[:, None] - self.centres
        nearest = np.abs(apart).argmin(axis=1)[:, None]
        return np.asarray(np.take_along_axis(apart, nearest, axis=1)[:, 0])

    def distance_from_places(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance from the neighbours among the training cases, (cases,)."""
        n = min(_N_NEIGHBOURS, len(self.points))
        if n == 0:
            return np.zeros(len(places))
        found = np.empty(len(places))
        step = max(1, _MOST_PAIRS // len(self.points))
        for k in range(0, len(places), step):
            apart = places[k : k + step, None] / self.scales - self._scaled_points
            squares = np.einsum("ijk,ijk->ij", _known(apart), apart)
            found[k : k + step] = np.partition(squares, n - 1, axis=1)[:, n - 1]
        return np.sqrt(found)


ARRAYS: Final = (
    "means",
    "whitening",
    "spreads",
    "points",
    "scales",
    "directions",
    "centres",
    "course",
    "limits",
)
"""Names of the arrays of a domain."""


def _known(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Put 0 in the place of what is not known, in these values themselves."""
    np.copyto(values, 0.0, where=np.isnan(values))
    return values


def motion_limits(
    motions: NDArray[np.float64], smooth_shares: NDArray[np.float64]
) -> tuple[float, float]:
    """Least motion and least smooth share, from those of the training cases."""
    return (
        min(_LEAST_MOTION, _SHARE_OF_LEAST * float(motions.min())),
        min(_LEAST_SMOOTH, _SHARE_OF_LEAST * float(smooth_shares.min())),
    )
