"""The measurement's noise, estimated from a sequence itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.choice.fitter import Fitter
from modalmotion.choice.nested_sets import Ladder
from modalmotion.choice.noise_bands import FINE, Bands, bands_of, n_modes_of
from modalmotion.choice.noise_mixtures import MIXINGS, Mixtures
from modalmotion.choice.noise_paths import COST, Levels, Paths, over_time
from modalmotion.fit.fit import Fit
from modalmotion.mesh.sequence import MEAN, MeshSequence, Reference
from modalmotion.representation import shown

# Rounds of level and independent columns, each of which needs the other.
_ROUNDS: Final = 3

# Directions of time that nothing but noise must fill before a band's level is believed.
_FEWEST_DIRECTIONS: Final = 3

# Numbers of a band that count at most: bands are not wholly alike.
_MOST_NUMBERS: Final = 300.0

# Steps of the shares of the parts, and how far the estimate may be off where nothing else shows.
_STEPS: Final = 300
_OFF: Final = 1.15

# Share of the variance below which a part counts as none.
_LEAST_PART: Final = 1e-3

# Other costs of a direction of motion, whose estimates the range holds.
_OTHER_COSTS: Final = (COST / 2, COST * 2)

WIDE: Final = 1.5
"""Ends of the range that differ by more say that motion and noise cannot be told apart well."""


@shown("sigma", "lowest", "highest", "between_frames", "between_neighbours")
@dataclass(frozen=True)
class Noise:
    """Noise of each coordinate of each vertex in each frame.

    Parameters
    ----------
    sigma : float, length unit
        Standard deviation, `rounding` at least.
    lowest, highest : float, length unit
        Range of the standard deviation; no highest where nothing bounds it: one frame.
    between_frames : float
        Correlation of a vertex's noise in one frame with that in the next.
    between_neighbours : float
        Correlation of the noise of two neighbours in one frame.
    independent_vertices : float
        Vertices of independent noise that average like these.
    parts : tuple of float
        Shares in the variance of independent noise that is mixed with its neighbours 0, 1, 2,
        4, 8, 12, 16, 24, 32, 48 and 64 times.
    rounding : float, length unit
        Noise from storing the coordinates in their type.
    modes : int
        Spatial modes that were told apart.
    bands, bands_read : int
        Bands of the motion, coarse to fine, and those of them that hold nothing but noise in
        enough directions of time.
    """

    sigma: float
    lowest: float
    highest: float | None
    between_frames: float
    between_neighbours: float
    independent_vertices: float
    parts: tuple[float, ...]
    rounding: float
    modes: int
    bands: int
    bands_read: int

    def note(self, unit: str | None) -> str:
        """Describe the estimate and what it rests on."""
        unit = unit or "length units"
        size = f"{self.sigma:.3g} {unit}"
        if self.highest is None:
            return f"One frame is too few to estimate noise; {size} was assumed."
        if self.sigma <= self.rounding:
            return (
                f"The noise is that of the stored numbers, {size} a coordinate; no other shows, so "
                "modes are added until they describe rounding. Ask by tolerance for fewer."
            )
        text = (
            f"The noise was estimated at {size} a coordinate (standard deviation; between "
            f"{self.lowest:.3g} and {self.highest:.3g} {unit}), with correlations of "
            f"{self.between_neighbours:.2f} between neighbours and {self.between_frames:.2f} "
            f"between frames: from {self.bands_read} of {self.bands} bands, coarse to fine, "
            "whose paths over time hold more than the motion."
        )
        if self.highest > WIDE * self.lowest:
            text += " Motion and noise are hard to tell apart here."
        return text

    def displacement_rms(self, n_frames: int, reference: Reference, n_directions: int = 3) -> float:
        """RMS displacement that noise alone makes, the reference's own included, length unit."""
        return self.sigma * float(np.sqrt(n_directions * self.spread(n_frames, reference)))

    def spread(self, n_frames: int, reference: Reference) -> float:
        """Mean square of a coordinate's displacement by noise of variance 1."""
        correlations = over_time(self.between_frames, n_frames)
        if reference == MEAN:
            return 1.0 - float(correlations.mean())
        return 2.0 * (1.0 - float(correlations[reference].mean()))


@dataclass(frozen=True, eq=False)
class _Estimate:
    """Variances of the parts, in units of the bands' scale squared, and what they came from."""

    parts: NDArray[np.float64]
    correlation: float
    levels: Levels
    is_read: NDArray[np.bool_]

    @property
    def variance(self) -> float:
        return float(self.parts.sum())


def estimate_noise(fitter: Fitter, ladder: Ladder, fit: Fit) -> Noise:
    """Estimate the noise's level, and its correlations in space and time.

    Taken for normal, of one level everywhere, a sum of independent parts that are mixed with
    their neighbours, and an autoregression of order 1 over time. A motion is taken for few
    directions of time, the same in all bands, slow ones first.

    Parameters
    ----------
    fitter : Fitter
        Of Cartesian components.
    ladder : Ladder
    fit : Fit
        Of the ladder's largest set.
    """
    sequence, template = fitter.sequence, fitter.template
    rounding = _rounding(sequence)
    m = n_modes_of(ladder, template)
    white = (1.0,) + (0.0,) * (len(MIXINGS) - 1)
    n_weighted = int((template.weights > 0).sum())
    if sequence.n_frames < 2 or n_weighted <= m:
        return Noise(rounding, rounding, None, 0.0, 0.0, n_weighted, white, rounding, m, 0, 0)
    mixtures = Mixtures.of(template)
    bands = bands_of(fitter, ladder, fit, mixtures)
    n_bands = len(bands.grams)
    if not np.trace(bands.grams, axis1=1, axis2=2).max() > 0.0:
        return Noise(
            rounding, rounding, rounding, 0.0, 0.0, n_weighted, white, rounding, m, n_bands, n_bands
        )
    paths = Paths(bands.grams, max(n_bands - FINE, 1))
    best = _estimate(bands, paths, np.array(white))
    variances = [best.variance, *_other_variances(bands, paths, best)]
    # Parts of next to nothing are none.
    parts = np.where(best.parts > _LEAST_PART * best.variance, best.parts, 0.0)
    parts /= parts.sum()
    lowest, highest = (bands.scale * float(np.sqrt(v)) for v in (min(variances), max(variances)))
    sigma = max(bands.scale * float(np.sqrt(best.variance)), rounding)
    is_rounding = sigma == rounding
    return Noise(
        sigma=sigma,
        lowest=max(lowest / _OFF, rounding),
        highest=max(highest * _OFF, rounding),
        between_frames=0.0 if is_rounding else best.correlation,
        between_neighbours=0.0 if is_rounding else float(parts @ mixtures.beside()),
        independent_vertices=mixtures.independent(parts, template.weights),
        parts=white if is_rounding else tuple(parts.tolist()),
        rounding=rounding,
        modes=m,
        bands=n_bands,
        bands_read=int(best.is_read.sum()),
    )


def _estimate(bands: Bands, paths: Paths, parts: NDArray[np.float64]) -> _Estimate:
    for _ in range(_ROUNDS):
        columns = _columns(bands, parts)
        correlation = paths.correlation(columns)
        estimate = _at(bands, paths, columns, correlation)
        parts = estimate.parts
    return estimate


def _other_variances(bands: Bands, paths: Paths, best: _Estimate) -> list[float]:
    """Variances by other rules that are as good: what they differ by cannot be known."""
    columns = _columns(bands, best.parts)
    half = len(columns) // 2
    others = [paths.correlation(columns, cost) for cost in _OTHER_COSTS]
    others += [paths.correlation(columns, bands=part) for part in (slice(half), slice(half, None))]
    estimates = [_at(bands, paths, columns, correlation) for correlation in others]
    estimates += [
        _at(bands, paths, columns, best.correlation, all_times=True),
        _at(bands, paths, columns, best.correlation, all_bands=True),
    ]
    return [estimate.variance for estimate in estimates]


def _columns(bands: Bands, parts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Independent columns of each band, all three directions."""
    columns = bands.independent(parts)
    # Noise so smooth that it has fewer cannot be told from motion, which would pass for it.
    white = bands.independent(np.eye(len(parts))[0])
    columns[:-FINE] = np.maximum(columns[:-FINE], 0.5 * white[:-FINE])
    return 3.0 * columns


def _at(
    bands: Bands,
    paths: Paths,
    columns: NDArray[np.float64],
    correlation: float,
    *,
    all_times: bool = False,
    all_bands: bool = False,
) -> _Estimate:
    levels = paths.levels(correlation, columns, all_times=all_times)
    numbers = levels.columns * levels.directions
    is_read = (levels.directions >= _FEWEST_DIRECTIONS) & (levels.columns > 3.0)
    place = np.arange(len(columns))
    if levels.n_directions < _FEWEST_DIRECTIONS:
        # So few frames are all motion where the modes are.
        is_read = place >= len(columns) - FINE
    elif levels.n_directions < 2 * _FEWEST_DIRECTIONS:
        is_read &= place >= len(columns) // 2
    if not is_read.any():
        is_read = place >= len(columns) - FINE
    if all_bands:
        is_read = np.ones(len(columns), dtype=np.bool_)
    weights = np.where(is_read, np.clip(numbers, 1.0, _MOST_NUMBERS), 0.0)
    expected, energies = bands.expected[:, is_read], levels.energies[is_read] / 3.0
    parts = _parts_of(expected, energies, weights[is_read])
    # The parts tell the shape; the level is that of the bands with most energy.
    total = max(float(energies.sum()), 1e-200)
    return _Estimate(
        parts * (total / float((parts @ expected).sum())), correlation, levels, is_read
    )


def _parts_of(
    expected: NDArray[np.float64], energies: NDArray[np.float64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Variances of the parts that make the bands' energies most likely.

    Energies are Gamma variables about mu = parts @ expected; steps that keep all variances above
    zero never lower the likelihood: Fevotte, Bertin and Durrieu, Nonnegative matrix
    factorization with the Itakura-Saito divergence, Neural Computation, 2009.
    """
    size = float(energies.max())
    if size == 0.0:
        return np.full(len(expected), 1e-200)
    energies = np.maximum(energies / size, 1e-40)
    parts = np.full(len(expected), float(np.median(energies / expected[0])) / len(expected))
    for _ in range(_STEPS):
        mu = parts @ expected
        parts = parts * np.sqrt(
            (expected @ (weights * energies / mu**2)) / (expected @ (weights / mu))
        )
        parts = np.maximum(parts, 1e-60)
    result: NDArray[np.float64] = parts * size
    return result


def _rounding(sequence: MeshSequence) -> float:
    """Give the standard deviation that rounding to the stored type adds to a coordinate."""
    largest = float(np.abs(sequence.vertices).max(initial=0.0))
    step = float(np.spacing(sequence.vertices.dtype.type(largest)))
    return step / float(np.sqrt(12.0))
