"""Oscillators under a force that grows, against the solution to many digits."""

from __future__ import annotations

import mpmath as mp
import numpy as np
from extremes_oscillator_rows import exact

from modalmotion.modes import Oscillators, State, exact_step


def forced_error(rng: np.random.Generator) -> float:
    """Largest error of one step of equation (3), over the size of what it adds up."""
    worst, h = 0.0, 1.3
    for w in (0.0, 1e-9, 0.7, 30.0):
        for c in (0.0, 1e-9, 0.3, 1.4, 1.4 * (1 + 1e-9), 60.0, 1e4, 1e8):
            u, v, before, after = rng.standard_normal(4)
            step = exact_step(Oscillators(np.array([w]), c), h)
            force = np.array([before]), np.array([after])
            found = step.advance_forced(State(np.array([u]), np.array([v])), *force).amplitudes[0]
            rise = (mp.mpf(after) - mp.mpf(before)) / mp.mpf(h)
            shares = {"kept": mp.mpf(u), "impulse": mp.mpf(v), "step": mp.mpf(before), "ramp": rise}
            parts = exact(w, c, h)
            true = sum(parts[name][0] * share for name, share in shares.items())
            size = sum(parts[name][1] * abs(share) for name, share in shares.items())
            worst = max(worst, float(abs(mp.mpf(float(found)) - true) / size))
    return worst
