"""Noise of a sequence, and the set of modes that stops there."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.choice.energies import Energies, energies_of
from modalmotion.choice.fitter import Fitter
from modalmotion.choice.nested_sets import Ladder
from modalmotion.choice.noise import Noise, estimate_noise
from modalmotion.choice.noise_mixtures import Mixtures
from modalmotion.choice.ordered_sets import ENERGY_POOL, sorted_ladder
from modalmotion.choice.parameters import MOST_MODES, ModeOrder
from modalmotion.mesh.sequence import Reference
from modalmotion.template.body_frame import Components

# The first ladder; each further one is twice as long.
_FIRST: Final = 128

# Risk that is as good as the least one: it is flat about the best set.
_NEXT_TO_LEAST: Final = 1.02


def measure_noise(fitter: Fitter) -> Noise:
    """Estimate a sequence's noise as its parameters measure displacements."""
    plain = fitter.asking(components=Components.CARTESIAN, order=ModeOrder.FIXED)
    return estimate_noise(plain, *sorted_ladder(plain, _FIRST))


def modes_until_noise(fitter: Fitter, noise: Noise) -> tuple[Ladder, int]:
    """Give a ladder of modes, and the number of them to keep.

    Parameters
    ----------
    fitter : Fitter
    noise : Noise
    """
    parameters = fitter.parameters
    most = parameters.most_modes or MOST_MODES
    n = min(_FIRST, most)
    mixtures, reference = Mixtures.of(fitter.template), parameters.reference
    if parameters.order == ModeOrder.ENERGY:
        n = most = parameters.most_modes or ENERGY_POOL
    while True:
        ladder, fit = sorted_ladder(fitter, n)
        shares = mixtures.shares(ladder, np.array(noise.parts))
        count = least_risk(ladder, energies_of(ladder.basis, fit), noise, shares, reference)
        if ladder.ends_because or n >= most or 4 * count <= 3 * ladder.counts[-1]:
            return ladder, count
        n = min(2 * n, most)


def least_risk(
    ladder: Ladder,
    energies: Energies,
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
    energies : Energies
    noise : Noise
    shares : (modes,) float64
        Of each mode in noise of variance 1.
    reference : int or "mean"
    """
    f = energies.n_frames
    variance = (noise.sigma / energies.scale) ** 2
    squares = (energies.coefficients**2).sum(axis=(0, 2)) / f
    noises = 3.0 * noise.spread(f, reference) * variance * shares
    counts = ladder.counts
    motion = np.append(np.cumsum((squares - noises)[::-1])[::-1], 0.0)[counts]
    motion = np.maximum(motion, 0.0)
    kept_noise = np.concatenate([[0.0], np.cumsum(noises)])[counts]
    risk = motion + kept_noise
    return int(counts[int(np.argmax(risk <= _NEXT_TO_LEAST * risk.min()))])
