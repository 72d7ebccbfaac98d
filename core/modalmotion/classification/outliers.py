"""What a recording must be like for a model to know its motion."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
import scipy

from modalmotion.classification.linear import class_means
from modalmotion.classification.motion import Motion
from modalmotion.classification.motion_features import (
    AXIS,
    Extractor,
    axis_parts,
    first,
    wave_features,
    waves_of,
)
from modalmotion.mesh.spring_modes import Modes
from modalmotion.representation import Array, Bools, Floats, Ints, shown

CHECKS: Final = ("kind", "place", "mirrored", "reversed")
"""Scores of a recording: the distance of its kind of motion from every class; that of its amount of
motion, size and elongation from those of training cases; how much it looks like its mirror image,
and like itself backwards."""

PLACE: Final = ("motion", "size", "elongation")
"""Coordinates of a place, all logarithms."""

# Neighbours among the training cases that a place is measured from.
_N_NEIGHBOURS: Final = 5
# Shrinkage towards independent features where there are many cases.
_LEAST_SHRINKAGE: Final = 1e-2
# Shares of the least motion and smoothness in training that a case must reach, and the highest
# such limits, for cohorts that all move a great deal.
_SHARE_OF_LEAST: Final = 0.5
_LEAST_MOTION: Final = 0.003
_LEAST_SMOOTH: Final = 0.5
# A step over so much of the extent of a cycle skips frames, unless one in training is as large.
_LARGEST_STEP: Final = 0.6
# Where the image of a class is nearer to another than this share of its distance from the class
# itself, the one is the image of the other, and an image is no fault.
_IMAGE: Final = 1.0 / 3.0
# Standard deviations by which a mirror image, and reversed time, must fit better to be named: sound
# time courses may be nearly symmetric, and then neither order of frames fits.
_NEARER: Final = (0.0, 1.0)
# A motion so small has no kind; its logarithm is still a number.
_NO_MOTION: Final = 1e-12

KNOWN_SHARE: Final = 0.99
"""Share of recordings like the training cases that are within all limits."""

NO_MOTION: Final = "no motion"
NOISE: Final = "noise"
UNDETERMINED: Final = "undetermined"
OUT_OF_DOMAIN: Final = "out of domain"
UNREADABLE: Final = "unreadable"
MIRRORED: Final = "mirrored"
REVERSED: Final = "reversed time"
INCOMPLETE: Final = "incomplete cycle"
OTHER_SIZE: Final = "other size"
OTHER_AMOUNT: Final = "other amount of motion"

FLAGS: Final = (
    *(NO_MOTION, NOISE, UNDETERMINED, OUT_OF_DOMAIN, UNREADABLE),
    *(MIRRORED, REVERSED, INCOMPLETE, OTHER_SIZE, OTHER_AMOUNT),
)
"""Nothing moves; nothing but noise moves; amplitudes are less than their deviations; unlike any
training case; not a signature that the model reads (another topology, other modes, one frame); and
in what a recording is unlike the training cases, where that is known. Where one is set, there is no
label."""


class Flag(NamedTuple):
    """A flag with its words: what was found, and what to do about it."""

    name: str
    words: str


class Inputs(NamedTuple):
    """Recordings as a detector reads them.

    Parameters
    ----------
    kinds : (cases, columns) float64
        What each motion is like, however large it is.
    places : (cases, 3) float64
        See `PLACE`.
    """

    kinds: Floats
    places: Floats

    def of(self, rows: Ints) -> "Inputs":
        """Those of some cases."""
        return Inputs(self.kinds[rows], self.places[rows])


def inputs_of(motions: Iterable[Motion], reader: Extractor) -> Inputs:
    """Read recordings."""
    kinds, places = [], []
    for motion in motions:
        modes = first(motion.modes, reader.n_modes)
        amount = max(motion.amount, _NO_MOTION)
        kinds.append(_kind(reader.terms(motion) / (100.0 * amount), modes, reader))
        places.append((math.log(amount), motion.log_size, motion.log_elongation))
    return Inputs(np.array(kinds), np.array(places))


def _kind(terms: Array, modes: Modes, reader: Extractor) -> Floats:
    if reader.what == AXIS:
        return axis_parts(terms, modes, walls=reader.walls)
    return wave_features(terms, waves_of(modes, walls=reader.walls))


def symmetry_signs(motion: Motion, reader: Extractor) -> Floats:
    """Signs by which the kinds of a mirror image and of reversed time differ, (2, columns).

    Each feature keeps its value or becomes its opposite, whatever the motion: random terms show
    which.
    """
    modes, terms = first(motion.modes, reader.n_modes), reader.terms(motion)
    rng = np.random.default_rng(0)
    some = rng.standard_normal(terms.shape)
    if reader.is_cycle:
        some = some + 1j * rng.standard_normal(terms.shape)
        backwards = some.conj()
    else:
        backwards = some * (-1.0) ** np.arange(1, len(some) + 1)[:, None, None]
    mirrored = some
    if motion.signature.landmarks is not None:
        # A mirror image reverses theta, and the direction across its zero.
        signs = np.where(modes.is_sine, -1.0, 1.0)[:, None]
        mirrored = some * signs * np.array([1.0, -1.0, 1.0])[: some.shape[2]]
    own = _kind(some, modes, reader)
    images = (_kind(image, modes, reader) for image in (mirrored, backwards))
    return np.stack([np.where(own * image < 0.0, -1.0, 1.0) for image in images])


@shown("limits")
@dataclass(frozen=True, eq=False)
class OutlierDetector:
    """Where the training cases lie.

    It reads features of its own, so that it does not depend on those that distinguish classes.

    Parameters
    ----------
    reader : Extractor
        Modes and timing.
    knows_size : bool
        Whether sizes compare: of all training cases or of none the unit is known.
    has_unit : bool
    means : (classes, columns) float64
        Of the kinds.
    whitening : (columns, columns) float64
        |(kind - mean) @ whitening| is the distance in standard deviations within a class
        (Mahalanobis), over the root of the number of columns.
    points : (cases, 3) float64
        Places of the training cases.
    scales : (3,) float64
        Standard deviations of these within a class; infinite for what does not vary.
    directions : (2, columns) float64
        Along which motions differ most from their mirror images and from themselves backwards,
        of unit variance within a class.
    signs : (2, columns) float64
        See `symmetry_signs`.
    limits : (checks,) float64
        Of the scores; infinite for what is not checked.
    bounds : (3,) float64
        Deformation, as a share of the size, below which nothing moves; smooth share below which a
        motion is noise; largest step, as a share of the extent of a cycle, above which frames are
        missing.
    """

    reader: Extractor
    knows_size: bool
    has_unit: bool
    means: Floats
    whitening: Floats
    points: Floats
    scales: Floats
    directions: Floats
    signs: Floats
    limits: Floats
    bounds: Floats

    def read(self, motion: Motion) -> Inputs:
        """Read one recording."""
        inputs = inputs_of((motion,), self.reader)
        if not self.knows_size or self.has_unit != (motion.signature.unit is not None):
            # In a unit that does not compare the size is as usual.
            inputs.places[0, 1] = np.median(self.points[:, 1])
        return inputs

    def distances(self, kinds: Floats) -> Floats:
        """Distances from all classes, (cases, classes), of kinds (cases, columns)."""
        apart = (kinds[:, None] - self.means) @ self.whitening
        return np.asarray(np.sqrt(np.einsum("ijk,ijk->ij", apart, apart)))

    def scores(self, inputs: Inputs) -> Floats:
        """Scores of `CHECKS`, (cases, checks): the larger, the stranger."""
        # How far each falls short of the nearest class along the directions, and its images do.
        seen = np.stack([self.directions.T, (self.signs * self.directions).T])
        short = (self.means @ self.directions.T)[:, None, None] - inputs.kinds @ seen
        nearest = np.abs(short).argmin(axis=0)[None]
        as_it_is, turned = np.take_along_axis(short, nearest, axis=0)[0]
        is_image = as_it_is - np.maximum(turned, 0.0) > _NEARER
        images = np.where(is_image, as_it_is, np.minimum(as_it_is, 0.0))
        least = self.distances(inputs.kinds).min(axis=1)
        return np.column_stack([least, self._from_places(inputs.places), images])

    def flags(self, motion: Motion) -> tuple[Flag, ...]:
        """Flag a recording for what speaks against an answer."""
        least_motion, least_smooth, largest_step = self.bounds.tolist()
        smooth = motion.smooth_share(self.reader.is_cycle)
        if motion.amount < least_motion or motion.amount == 0.0:
            text = f"no motion: it deforms by {motion.amount:.2%} of its size, less than"
            return (Flag(NO_MOTION, f"{text} {least_motion:.2%}"),)
        if smooth < least_smooth:
            text = "the motion is mostly noise from frame to frame (a smooth one would have 1, this"
            return (Flag(NOISE, f"{text} one has {smooth:.2f})"),)
        share = motion.signature.deviation_share
        if share is not None and share >= 1.0:
            words = (
                f"the amplitudes are not determined: their standard deviations are {share:.2g} "
                "times as large as they are. Record more points, or points of more of the surface"
            )
            return (Flag(UNDETERMINED, words),)
        if self.reader.is_cycle and motion.largest_step > largest_step:
            words = (
                "frames of the cycle are missing, or too few: between two frames it moves over "
                f"{motion.largest_step:.0%} of the extent of its motion. Send one whole cycle, in "
                "as many frames as there are"
            )
            return (Flag(INCOMPLETE, words),)
        inputs = self.read(motion)
        scores = self.scores(inputs)[0]
        beyond = dict(zip(CHECKS, (scores > self.limits).tolist(), strict=True))
        flags = [flag for check, flag in _OF_CHECKS.items() if beyond[check]][:1]
        if beyond["place"]:
            flags.append(self._of_place(inputs.places[0]))
        if not flags and beyond["kind"]:
            words = (
                "the motion is unlike any that the model was trained on (distance "
                f"{scores[0]:.2f} from the nearest class, limit {self.limits[0]:.2f})"
            )
            flags.append(Flag(OUT_OF_DOMAIN, words))
        return tuple(flags)

    def _from_places(self, places: Floats) -> Floats:
        """Distance from the fifth neighbour among the training cases, (cases,)."""
        n = min(_N_NEIGHBOURS, len(self.points))
        apart = scipy.spatial.distance.cdist(places / self.scales, self.points / self.scales)
        return np.asarray(np.partition(apart, n - 1, axis=1)[:, n - 1])

    def _of_place(self, place: Floats) -> Flag:
        """Flag a size, shape or amount of motion unlike those of the training cases."""
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        outside = np.maximum(low - place, place - high) / self.scales
        farthest = PLACE[int(outside.argmax())] if outside.max() > 0.0 else "motion"
        if farthest == "size":
            least, most, own = (math.exp(value[1]) for value in (low, high, place))
            unit = " mm" if self.has_unit else ""
            words = (
                f"its size is {own:.3g}{unit}, and those of the training cases are {least:.3g} to "
                f"{most:.3g}{unit}. Check the unit, or train with surfaces of this size"
            )
            return Flag(OTHER_SIZE, words)
        if farthest == "elongation":
            words = (
                "its surface is longer or shorter for its width than that of any training case. "
                "Check that it is the surface that the model is for"
            )
            return Flag(OUT_OF_DOMAIN, words)
        apart = (self.points - place) / self.scales
        near = np.argsort((apart[:, 1:] ** 2).sum(axis=1), kind="stable")[:_N_NEIGHBOURS]
        times = math.exp(place[0] - float(np.median(self.points[near, 0])))
        words = (
            f"its motion ({math.exp(place[0]):.1%} of its size) is {times:.2g} times that of "
            "training cases of about its size and shape. Check the scale of the displacements"
        )
        return Flag(OTHER_AMOUNT, words)


_OF_CHECKS: Final = {
    "mirrored": Flag(
        MIRRORED,
        "its mirror image fits the training cases and the motion itself does not, as where one "
        "axis of the coordinates was negated. State the handedness (handedness=left), or send it "
        "in right-handed coordinates",
    ),
    "reversed": Flag(
        REVERSED,
        "backwards it fits the training cases and as it is it does not. Check the order of the "
        "frames",
    ),
}


def detector_for(
    motions: Sequence[Motion],
    y: Ints,
    reader: Extractor,
    folds: Iterable[tuple[Ints, Ints]],
    groups: Ints,
) -> OutlierDetector:
    """Fit a detector to training cases, with limits that cases held out stay within.

    Parameters
    ----------
    motions : sequence of Motion
    y : (cases,) int64
        Classes from 0.
    reader : Extractor
    folds : iterable of ((n,) int64, (m,) int64)
        Each case is held out once; without any folds nothing is beyond the limits.
    groups : (cases,) int64
        As in `with_limits`.
    """
    units = {motion.signature.unit is not None for motion in motions}
    smooth = min(motion.smooth_share(reader.is_cycle) for motion in motions)
    amount = min(motion.amount for motion in motions)
    bounds = (
        min(_LEAST_MOTION, _SHARE_OF_LEAST * amount),
        min(_LEAST_SMOOTH, _SHARE_OF_LEAST * smooth),
        max(_LARGEST_STEP, *(motion.largest_step for motion in motions)),
    )
    inputs = inputs_of(motions, reader)
    if len(units) > 1:
        inputs.places[:, 1] = 0.0
    signs, n_classes = symmetry_signs(motions[0], reader), int(y.max()) + 1

    def fitted(rows: Ints) -> OutlierDetector:
        (kinds, places), own = inputs.of(rows), y[rows]
        spread = kinds.std(axis=0)
        spread = np.where(spread > 1e-12 * np.abs(kinds).max(axis=0), spread, np.inf)
        means = class_means(kinds, own, n_classes)
        means[np.bincount(own, minlength=n_classes) == 0] = kinds.mean(axis=0)
        scales = (places - class_means(places, own, n_classes)[own]).std(axis=0)
        return OutlierDetector(
            reader=reader,
            knows_size=len(units) == 1,
            has_unit=True in units,
            means=means,
            whitening=_whitening((kinds - means[own]) / spread) / spread[:, None],
            points=places,
            scales=np.where(scales > 1e-9 * np.abs(places).max(axis=0), scales, np.inf),
            directions=np.stack([_direction(kinds, means, own, one < 0) for one in signs]),
            signs=signs,
            limits=np.full(len(CHECKS), np.inf),
            bounds=np.array(bounds),
        )

    scores = np.full((len(y), len(CHECKS)), np.nan)
    for inner, outer in folds:
        scores[outer] = fitted(inner).scores(inputs.of(outer))
    detector = fitted(np.arange(len(y)))
    return detector if np.isnan(scores).any() else with_limits(detector, scores, groups)


def with_limits(detector: OutlierDetector, scores: Floats, groups: Ints) -> OutlierDetector:
    """Give a detector the limits within which a share of new cases stays in all scores together.

    Each has its own limit; then all are raised by one number of their standard deviations.

    Parameters
    ----------
    detector : OutlierDetector
    scores : (cases, checks) float64
        Of cases that took no part in a fit.
    groups : (cases,) int64
        Of each only the highest score counts, for its cases are not independent.
    """
    _, place = np.unique(groups, return_inverse=True)
    own = np.full((int(place.max()) + 1, scores.shape[1]), -np.inf)
    np.maximum.at(own, place, scores)
    limits = np.array([_limit(column) for column in own.T])
    widths = scores.std(axis=0)
    varies = widths > 1e-9 * np.abs(scores).max(axis=0)
    limits[~varies] = np.inf
    if varies.any():
        beyond = ((own - limits)[:, varies] / widths[varies]).max(axis=1)
        limits[varies] += max(0.0, _limit(beyond)) * widths[varies]
    turned = slice(CHECKS.index("mirrored"), None)
    images = [detector.distances(detector.means * signs) for signs in detector.signs]
    is_told = [not (apart < _IMAGE * apart.diagonal()[:, None]).any() for apart in images]
    limits[turned] = np.where(is_told, np.maximum(limits[turned], 0.0), np.inf)
    return replace(detector, limits=limits)


def _limit(held_out: Floats) -> float:
    """Score that a share of new cases stays within.

    The k-th of n is exceeded by a new one with probability 1 - k / (n + 1). Where the farthest is
    exceeded too often, the scores are taken to thin out beyond it exponentially: of n such ones
    the largest is expected at b (1 + 1/2 + ... + 1/n), and the median at b log 2.
    """
    n, ordered = len(held_out), np.sort(held_out)
    rank = int(np.ceil(KNOWN_SHARE * (n + 1) - 1e-9))
    if rank <= n:
        return float(ordered[rank - 1])
    b = (ordered[-1] - np.median(ordered)) / ((1.0 / np.arange(1, n + 1)).sum() - np.log(2.0))
    return float(ordered[-1] - b * np.log((n + 1) * (1.0 - KNOWN_SHARE)))


def _whitening(residuals: Floats) -> Floats:
    """Whitening of the shrunk covariance of residuals, over the root of the columns."""
    n, d = residuals.shape
    S = residuals.T @ residuals / n
    variances = np.diag(S)
    # With fewer cases than features nothing is known of most directions.
    share = max(_LEAST_SHRINKAGE, d / (n + d))
    S = (1.0 - share) * S + share * np.diag(np.where(variances > 0, variances, 1.0))
    return np.asarray(np.linalg.inv(np.linalg.cholesky(S)).T / np.sqrt(d))


def _direction(kinds: Floats, means: Floats, y: Ints, changes: Bools) -> Floats:
    """Along which motions differ most from their images (Fisher), over the columns that change."""
    direction = np.zeros(kinds.shape[1])
    scale = kinds.std(axis=0)
    used = changes & (scale > 1e-12 * np.abs(kinds).max(axis=0))
    if not used.any():
        return direction
    W = _whitening((kinds - means[y])[:, used] / scale[used]) * np.sqrt(used.sum())
    towards = W.T @ (means[np.unique(y)][:, used] / scale[used]).mean(axis=0)
    length = float(np.linalg.norm(towards))
    if length > 0.0:
        direction[used] = W @ towards / length / scale[used]
    return direction
