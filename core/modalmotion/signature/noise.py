"""The measurement's noise, estimated from a sequence itself, and the modes that rise above it."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from modalmotion.mesh.sequence import MEAN, MeshSequence, Reference
from modalmotion.notes import Note
from modalmotion.numeric.scales import power_of_two
from modalmotion.representation import Floats, shown
from modalmotion.signature import noise_bands, parameters
from modalmotion.signature.fit import Fitter
from modalmotion.signature.nested_modes import NestedModes, nested_modes
from modalmotion.template.body_frame import Components

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
    mixed : int
        Times that independent noise is to be averaged over neighbours to be as smooth.
    rounding : float, length unit
        Noise from storing the coordinates in their type.
    modes : int
        Spatial modes that were told apart.
    """

    sigma: float
    lowest: float
    highest: float | None
    between_frames: float
    between_neighbours: float
    independent_vertices: float
    mixed: int
    rounding: float
    modes: int

    def note(self, unit: str | None) -> Note:
        """Describe the estimate and what it rests on."""
        unit = unit or "length units"
        size = f"{self.sigma:.3g} {unit}"
        if self.highest is None:
            return Note.of("noise_assumed", size=size)
        if self.sigma <= self.rounding:
            return Note.of("noise_of_rounding", size=size)
        is_wide = self.highest > WIDE * self.lowest
        return Note.of(
            "noise",
            size=size,
            lowest=self.lowest,
            highest=self.highest,
            unit=unit,
            neighbours=self.between_neighbours,
            frames=self.between_frames,
            n_modes=self.modes,
            doubt=" Motion and noise are hard to distinguish here." * is_wide,
        )

    def displacement_rms(self, n_frames: int, reference: Reference, n_directions: int = 3) -> float:
        """RMS displacement that noise alone makes, the reference's own included, length unit."""
        return self.sigma * float(np.sqrt(n_directions * self.spread(n_frames, reference)))

    def spread(self, n_frames: int, reference: Reference) -> float:
        """Mean square of a coordinate's displacement by noise of variance 1."""
        correlations = noise_bands.over_time(self.between_frames, n_frames)
        if reference == MEAN:
            return 1.0 - float(correlations.mean())
        return 2.0 * (1.0 - float(correlations[reference].mean()))

    @property
    def excess(self) -> float:
        """Factor by which pure noise exceeds its expected RMS at most."""
        # The reference's part of the noise is drawn once for all frames.
        spread = float(np.sqrt(2.0 / (3.0 * self.independent_vertices)))
        # Not squared: the square of very large coordinates would overflow.
        return float(np.sqrt(1.0 + _ESTIMATE + _DEVIATIONS * spread))


# Pure noise exceeds its expected mean square by this many standard deviations at most, and
# its estimate is right to this share.
_DEVIATIONS: Final = 3.0
_ESTIMATE: Final = 0.03


# Modes of the first nested sets; each further ones are twice as many.
_FIRST: Final = 120

# Risk that is as good as the least one: it is flat about the best set.
_NEXT_TO_LEAST: Final = 1.02

# Correlations of a frame with the next that are compared.
_CORRELATIONS: Final = (
    *(-0.3, -0.15, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8),
    *(0.85, 0.9, 0.93, 0.96, 0.98),
)

# What a direction of motion costs in log-likelihood; without it all noise is called motion.
_COST: Final = 6.0

# Rounds of smoothness and correlation, each of which needs the other.
_ROUNDS: Final = 2

# Mixings up to here are all compared; those beyond grow by a factor, and are interpolated.
_GEOMETRIC: Final = 3

# Share of what lacks to 1 that the correlation may be off.
_SLOWER: Final = 0.1

# Frames from which on directions of time tell motion from noise.
_FEW_FRAMES: Final = 5

# How far the estimate may be off where nothing else shows.
_OFF: Final = 1.15


@dataclass(frozen=True, eq=False)
class Found:
    """A noise, and what it was estimated by.

    Parameters
    ----------
    noise : Noise
    nested : NestedModes
    coefficients : (frames, modes, 3) float64, length unit
        Of the largest set.
    smooth : SmoothNoise
        On the same template.
    """

    noise: Noise
    nested: NestedModes
    coefficients: Floats
    smooth: noise_bands.SmoothNoise


def estimated(fitter: Fitter) -> Found:
    """Estimate a sequence's noise as its parameters measure displacements."""
    plain = fitter.asking(components=Components.CARTESIAN)
    nested, coefficients = _nested(plain, _FIRST)
    smooth = noise_bands.SmoothNoise.on(plain.template)
    return Found(_noise(plain, nested, coefficients, smooth), nested, coefficients, smooth)


def _noise(
    fitter: Fitter, nested: NestedModes, coefficients: Floats, smooth: noise_bands.SmoothNoise
) -> Noise:
    """Estimate the noise's level, and its correlations in space and time.

    Taken for normal, of one level and one smoothness everywhere, and an autoregression of order 1
    over time.
    """
    sequence, weights = fitter.sequence, fitter.template.weights
    rounding, n_weighted = _rounding(sequence), int((weights > 0).sum())
    if sequence.n_frames < 2 or n_weighted < 2:
        return Noise(rounding, rounding, None, 0.0, 0.0, n_weighted, 0, rounding, 0)
    bands = noise_bands.bands_of(fitter, nested, coefficients, smooth)
    if not bands.grams.max() > 0.0:
        return Noise(rounding, rounding, rounding, 0.0, 0.0, n_weighted, 0, rounding, bands.modes)
    variance, others, correlation, k = _variances(bands)
    sigma = bands.scale * float(np.sqrt(variance))
    lowest, highest = (bands.scale * float(np.sqrt(v)) for v in (min(others), max(others)))
    if sigma <= rounding:
        correlation, k = 0.0, 0
    white, mixed = noise_bands.independent(noise_bands.products_of(smooth.fields[[0, k]], weights))
    return Noise(
        sigma=max(sigma, rounding),
        lowest=max(lowest / _OFF, rounding),
        highest=max(highest * _OFF, rounding),
        between_frames=correlation,
        between_neighbours=smooth.beside(k) if k else 0.0,
        # Chance cancels in the ratio of smooth fields to white ones, whose number is known.
        independent_vertices=float(mixed / white / (weights**2).sum()),
        mixed=noise_bands.MIXINGS[k],
        rounding=rounding,
        modes=bands.modes,
    )


def _variances(bands: noise_bands.Bands) -> tuple[float, list[float], float, int]:
    """Variance, those by other rules that are as good, correlation in time and smoothness."""
    whitened = bands.whitened(_CORRELATIONS)

    def correlation(k: int, cost: float = _COST) -> float:
        found = noise_bands.likelihoods(*whitened, bands.columns[k], cost)
        return float(np.interp(_peak(found), np.arange(len(found)), _CORRELATIONS))

    def level(correlation: float, k: int, cost: float = _COST) -> tuple[float, int]:
        (energies,), _ = bands.whitened((correlation,))
        variances, found = noise_bands.levels_of(energies, bands.expected, bands.columns[k], cost)
        at = _peak(found)
        near = int(np.argmax(found))
        # Small numbers of mixings are all compared, and only beyond is anything between them.
        at = at if near > _GEOMETRIC else near
        return float(np.exp(np.interp(at, np.arange(len(found)), np.log(variances)))), near

    k = 0
    for _ in range(_ROUNDS):
        best = correlation(k)
        variance, k = level(best, k)
    others = [variance]
    others += [level(correlation(k, cost), k, cost)[0] for cost in (_COST / 2, _COST * 2)]
    (energies,), _ = bands.whitened((best,))
    half = len(energies) // 2
    for some in (slice(half), slice(half, None)):
        part = bands.expected[:, some], bands.columns[k][some]
        others.append(float(noise_bands.levels_of(energies[some], *part, _COST)[0][k]))
    # An autoregression is the slower the less of it the quick directions show.
    others += [level(best + off * (1.0 - abs(best)), k)[0] for off in (-_SLOWER, _SLOWER)]
    if bands.grams.shape[2] < _FEW_FRAMES:
        # So few are all motion where the modes are; what they leave is taken for independent.
        variance = float(energies[-1].mean()) / bands.expected[0, -1] / 3.0
        return variance, [variance, *others], 0.0, 0
    return variance, others, best, k


def _peak(found: Floats) -> float:
    """Place of the largest likelihood, by a parabola through its neighbours."""
    k = int(np.argmax(found))
    if not 0 < k < len(found) - 1:
        return float(k)
    a, b, _ = np.polyfit([-1.0, 0.0, 1.0], found[k - 1 : k + 2] - found[k], 2)
    return k + (float(np.clip(-b / (2.0 * a), -0.5, 0.5)) if a < 0.0 else 0.0)


def modes_until_noise(fitter: Fitter, found: Found) -> tuple[NestedModes, int]:
    """Give nested sets of modes, and the number of modes to keep."""
    noise, nested, coefficients, n = found.noise, found.nested, found.coefficients, _FIRST
    if fitter.parameters.components != Components.CARTESIAN:
        nested, coefficients = _nested(fitter, n)
    while True:
        shares = noise_bands.shares_of(nested.basis, found.smooth, noise.mixed)
        count = least_risk(nested, coefficients, noise, shares, fitter.parameters.reference)
        if nested.ends_because or n >= parameters.MOST_MODES or 4 * count <= 3 * nested.counts[-1]:
            return nested, count
        n = min(2 * n, parameters.MOST_MODES)
        nested, coefficients = _nested(fitter, n)


def _nested(fitter: Fitter, n: int) -> tuple[NestedModes, Floats]:
    nested = nested_modes(fitter.template, n, fitter.sequence.grid)
    return nested, fitter.along(nested.basis.analysis)


def least_risk(
    nested: NestedModes, coefficients: Floats, noise: Noise, shares: Floats, reference: Reference
) -> int:
    """Smallest whole set whose expected distance from the motion without noise is next to least.

    A mode that is kept brings its noise, one that is dropped takes its motion with it, whose
    square is the coefficient's less that of its noise: an unbiased risk (Mallows, Some comments
    on C_p, Technometrics, 1973). The motion is the displacement from the true reference, and
    carries the noise of its frame and of the reference.

    Parameters
    ----------
    nested : NestedModes
    coefficients : (frames, modes, n) float64, length unit
    noise : Noise
    shares : (modes,) float64
        Of each mode in noise of variance 1.
    reference : int or "mean"
    """
    f, scale = len(coefficients), power_of_two(float(np.abs(coefficients).max(initial=0.0)))
    variance = (noise.sigma / scale) ** 2
    squares = ((coefficients / scale) ** 2).sum(axis=(0, 2)) / f
    noises = 3.0 * noise.spread(f, reference) * variance * shares
    counts = nested.counts
    motion = np.append(np.cumsum((squares - noises)[::-1])[::-1], 0.0)[counts]
    motion = np.maximum(motion, 0.0)
    kept_noise = np.concatenate([[0.0], np.cumsum(noises)])[counts]
    risk = motion + kept_noise
    return int(counts[int(np.argmax(risk <= _NEXT_TO_LEAST * risk.min()))])


def _rounding(sequence: MeshSequence) -> float:
    """Give the standard deviation that rounding to the stored type adds to a coordinate."""
    largest = float(np.abs(sequence.vertices).max(initial=0.0))
    step = float(np.spacing(sequence.vertices.dtype.type(largest)))
    return step / float(np.sqrt(12.0))
