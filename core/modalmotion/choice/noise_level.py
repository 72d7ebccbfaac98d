"""Noise of a sequence, and the set of modes that stops there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.choice.fitter import Fitter
from modalmotion.choice.nested_sets import Ladder, ladder_of
from modalmotion.choice.noise import Noise
from modalmotion.choice.noise_bands import Bands, bands_of, levels_of, likelihoods
from modalmotion.choice.ordered_sets import ENERGY_POOL, sorted_ladder
from modalmotion.choice.parameters import MOST_MODES, ModeOrder
from modalmotion.choice.smooth_noise import (
    MIXINGS,
    SmoothNoise,
    independent,
    products_of,
    shares_of,
)
from modalmotion.mesh.sequence import MeshSequence, Reference
from modalmotion.numeric.scale import power_of_two
from modalmotion.template.body_frame import Components

# The first ladder; each further one is twice as long.
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
    """What a noise was estimated by.

    Parameters
    ----------
    ladder : Ladder
    coefficients : (frames, modes, 3) float64, length unit
        Of the ladder's largest set.
    smooth : SmoothNoise
        On the same template.
    """

    ladder: Ladder
    coefficients: NDArray[np.float64]
    smooth: SmoothNoise


def measure_noise(fitter: Fitter) -> Noise:
    """Estimate a sequence's noise as its parameters measure displacements."""
    return with_ladder(fitter)[0]


def with_ladder(fitter: Fitter) -> tuple[Noise, Found]:
    """Estimate the noise, and give what it was estimated by."""
    plain = fitter.asking(components=Components.CARTESIAN, order=ModeOrder.FIXED)
    ladder = ladder_of(plain.template, _FIRST, plain.sequence.grid)
    smooth = SmoothNoise.on(plain.template)
    found = Found(ladder, plain.coefficients(ladder.basis), smooth)
    return estimate_noise(plain, found), found


def estimate_noise(fitter: Fitter, by: Found) -> Noise:
    """Estimate the noise's level, and its correlations in space and time.

    Taken for normal, of one level and one smoothness everywhere, and an autoregression of order 1
    over time.

    Parameters
    ----------
    fitter : Fitter
        Of Cartesian components.
    by : Found
    """
    sequence, weights = fitter.sequence, fitter.template.weights
    rounding, n_weighted = _rounding(sequence), int((weights > 0).sum())
    if sequence.n_frames < 2 or n_weighted < 2:
        return Noise(rounding, rounding, None, 0.0, 0.0, n_weighted, 0, rounding, 0)
    bands = bands_of(fitter, by.ladder, by.coefficients, by.smooth)
    if not bands.grams.max() > 0.0:
        return Noise(rounding, rounding, rounding, 0.0, 0.0, n_weighted, 0, rounding, bands.modes)
    variance, others, correlation, k = _variances(bands)
    sigma = bands.scale * float(np.sqrt(variance))
    lowest, highest = (bands.scale * float(np.sqrt(v)) for v in (min(others), max(others)))
    if sigma <= rounding:
        correlation, k = 0.0, 0
    white, smooth = independent(products_of(by.smooth.fields[[0, k]], weights))
    return Noise(
        sigma=max(sigma, rounding),
        lowest=max(lowest / _OFF, rounding),
        highest=max(highest * _OFF, rounding),
        between_frames=correlation,
        between_neighbours=by.smooth.beside(k) if k else 0.0,
        # Chance cancels in the ratio of smooth fields to white ones, whose number is known.
        independent_vertices=float(smooth / white / (weights**2).sum()),
        mixed=MIXINGS[k],
        rounding=rounding,
        modes=bands.modes,
    )


def _variances(bands: Bands) -> tuple[float, list[float], float, int]:
    """Variance, those by other rules that are as good, correlation in time and smoothness."""
    whitened = bands.whitened(_CORRELATIONS)

    def correlation(k: int, cost: float = _COST) -> float:
        found = likelihoods(*whitened, bands.columns[k], cost)
        return float(np.interp(_peak(found), np.arange(len(found)), _CORRELATIONS))

    def level(correlation: float, k: int, cost: float = _COST) -> tuple[float, int]:
        (energies,), _ = bands.whitened((correlation,))
        variances, found = levels_of(energies, bands.expected, bands.columns[k], cost)
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
        others.append(float(levels_of(energies[some], *part, _COST)[0][k]))
    # An autoregression is the slower the less of it the quick directions show.
    others += [level(best + off * (1.0 - abs(best)), k)[0] for off in (-_SLOWER, _SLOWER)]
    if bands.grams.shape[2] < _FEW_FRAMES:
        # So few are all motion where the modes are; what they leave is taken for independent.
        variance = float(energies[-1].mean()) / bands.expected[0, -1] / 3.0
        return variance, [variance, *others], 0.0, 0
    return variance, others, best, k


def _peak(found: NDArray[np.float64]) -> float:
    """Place of the largest likelihood, by a parabola through its neighbours."""
    k = int(np.argmax(found))
    if not 0 < k < len(found) - 1:
        return float(k)
    a, b, _ = np.polyfit([-1.0, 0.0, 1.0], found[k - 1 : k + 2] - found[k], 2)
    return k + (float(np.clip(-b / (2.0 * a), -0.5, 0.5)) if a < 0.0 else 0.0)


def modes_until_noise(fitter: Fitter, noise: Noise, by: Found) -> tuple[Ladder, int]:
    """Give a ladder of modes, and the number of them to keep.

    Parameters
    ----------
    fitter : Fitter
    noise : Noise
    by : Found
        What that was estimated by.
    """
    parameters, ladder, coefficients = fitter.parameters, by.ladder, by.coefficients
    most, n = parameters.most_modes or MOST_MODES, _FIRST
    if parameters.order == ModeOrder.ENERGY:
        most = n = parameters.most_modes or ENERGY_POOL
    is_fixed = parameters.order == ModeOrder.FIXED
    if not is_fixed or most < n or parameters.components != Components.CARTESIAN:
        n = min(n, most)
        ladder, coefficients = _ladder(fitter, n)
    while True:
        shares = shares_of(ladder, by.smooth, noise.mixed)
        count = least_risk(ladder, coefficients, noise, shares, parameters.reference)
        if ladder.ends_because or n >= most or 4 * count <= 3 * ladder.counts[-1]:
            return ladder, count
        n = min(2 * n, most)
        ladder, coefficients = _ladder(fitter, n)


def _ladder(fitter: Fitter, n: int) -> tuple[Ladder, NDArray[np.float64]]:
    if fitter.parameters.order == ModeOrder.ENERGY:
        ladder, _ = sorted_ladder(fitter, n)
    else:
        ladder = ladder_of(fitter.template, n, fitter.sequence.grid)
    return ladder, fitter.coefficients(ladder.basis)


def least_risk(
    ladder: Ladder,
    coefficients: NDArray[np.float64],
    noise: Noise,
    shares: NDArray[np.float64],
    reference: Reference,
) -> int:
    """Smallest whole set whose expected distance from the motion without noise is next to least.

    A mode that is kept brings its noise, one that is dropped takes its motion with it, whose
    square is the coefficient's less that of its noise: an unbiased risk (Mallows, Some comments
    on C_p, Technometrics, 1973). The motion is the displacement from the true reference, and
    carries the noise of its frame and of the reference.

    Parameters
    ----------
    ladder : Ladder
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
    counts = ladder.counts
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
