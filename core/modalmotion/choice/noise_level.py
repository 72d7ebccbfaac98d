"""Noise of a sequence, and the set of modes that stops there."""

from __future__ import annotations

from typing import Final

import numpy as np

from modalmotion.choice.energies import Energies, energies_of
from modalmotion.choice.fitter import Fitter
from modalmotion.choice.nested_sets import Ladder
from modalmotion.choice.noise import Noise, estimate_noise
from modalmotion.choice.ordered_sets import ENERGY_POOL, sorted_ladder
from modalmotion.choice.parameters import MOST_MODES, ModeOrder
from modalmotion.template.body_frame import Components

# The first ladder; each further one is twice as long.
_FIRST: Final = 128


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
    if parameters.order == ModeOrder.ENERGY:
        n = most = parameters.most_modes or ENERGY_POOL
    while True:
        ladder, fit = sorted_ladder(fitter, n)
        count = least_risk(ladder, energies_of(ladder.basis, fit), noise)
        if ladder.ends_because or n >= most or 4 * count <= 3 * ladder.counts[-1]:
            return ladder, count
        n = min(2 * n, most)


def least_risk(ladder: Ladder, energies: Energies, noise: Noise) -> int:
    """Whole set whose expected distance from the motion without noise is least.

    A mode that is kept brings its noise, one that is dropped takes its motion with it, whose
    square is the coefficient's less that of its noise: an unbiased risk (Mallows, Some comments
    on C_p, Technometrics, 1973). Measured from the true reference a displacement carries the
    noise of its frame and of the reference; positions on the reference as recorded carry the
    latter with any modes. The set is the one that is nearest to the best for both.

    Parameters
    ----------
    ladder : Ladder
    energies : Energies
    noise : Noise
    """
    f = energies.n_frames
    variance = (noise.sigma / energies.scale) ** 2
    squares = (energies.coefficients**2).sum(axis=(0, 2)) / f
    noises = 6.0 * (f - 1) / f * variance * ladder.noise_shares
    counts = ladder.counts
    motion = np.append(np.cumsum((squares - noises)[::-1])[::-1], 0.0)[counts]
    motion = np.maximum(motion, 0.0)
    kept_noise = np.concatenate([[0.0], np.cumsum(noises)])[counts]
    displaced, placed = motion + kept_noise, motion + 3.0 * variance
    if not displaced.min() > 0.0:
        return int(counts[int(np.argmin(displaced))])
    excess = np.maximum(displaced / displaced.min(), placed / placed.min())
    return int(counts[int(np.argmin(excess))])
