"""A surface driven to its data by their force, as oscillators: the way that tracking does not go.

Equation (3), M u'' + C u' + K u = f, with the strain energy's K and the force of the data, ends at
rest where K u = f: at the amplitudes that `settle` finds. It takes hundreds of steps instead of
five, and shows how a surface is drawn to its data.

A force taken at the beginning of a step, f = b - A u, lags behind, and long steps would blow up.
So masses are the diagonal of A + K, every oscillator gets the same frequency W, and the force what
that adds, with z = M^1/2 u and H = M^-1/2 (A + K) M^-1/2:

    z'' + 2 W z' + W^2 z = g + (W^2 - H) z,     at rest at H z = g as before.

Along an eigenvector of H, of eigenvalue e <= W^2, a step of length h takes z and z' through a
matrix with

    determinant  D = B (1 - e S) + e G^2,     trace  T = 1 - e S + B,

B, S and G the responses of the oscillator without data (`dynamics.kernel`): with x = W h,
W^2 S = 1 - (1 + x) e^-x, B = (1 - x) e^-x and G = h e^-x. D is linear in e, (1 - x) e^-x at e = 0
and e^-2x at e = W^2, so |D| < 1; and 1 - T + D = e (S (1 - B) + G^2) > 0,
1 + T + D = (2 - e S)(1 + B) + e G^2 > 0. By Jury's conditions both roots lie inside the circle:
with W^2 the largest eigenvalue of H, or more, every step is stable, however long. (Equation numbers
are those of Nastar, 1994.)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.dynamics import Oscillators, State, exact_step
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.information import information
from modalmotion.tracking.noise import Noise
from modalmotion.tracking.observation import Frame


def driven_path(
    surface: Deformable,
    frame: Frame,
    start: NDArray[np.float64],
    variances: NDArray[np.float64],
    noise: Noise,
    *,
    n_matches: int,
    n_steps: int,
    step: float = 2.0,
) -> NDArray[np.float64]:
    """Let the force of one frame's data drive a surface.

    Parameters
    ----------
    surface : Deformable
    frame : Frame
    start : (modes, 3) float64, length unit
        Where it is at rest at first.
    variances : (modes,) float64, length unit squared
        K^-1.
    noise : Noise
    n_matches : int
        How often points and surface are matched anew.
    n_steps : int
        Between two matches.
    step : float
        Length of one, in units of 1 / W; any is stable.

    Returns
    -------
    (matches + 1, modes, 3) float64, length unit
        Amplitudes at the start and after each match.
    """
    stiffness = np.repeat(1.0 / variances, 3)
    path = [start]
    u, v = start.ravel(), np.zeros(start.size)
    for _ in range(n_matches):
        found = information(surface, u.reshape(-1, 3), frame, noise)
        H = found.matrix + np.diag(stiffness)
        root = np.sqrt(np.diag(H))
        scaled = H / root[:, None] / root
        # No eigenvalue exceeds the largest sum of a row (Gershgorin).
        W = float(np.sqrt(np.abs(scaled).sum(axis=1).max()))
        oscillators = Oscillators(np.full(len(u), W), 2.0 * W)
        exact = exact_step(oscillators, step / W)
        state, g = State(u * root, v * root), found.vector / root
        for _ in range(n_steps):
            z = state.amplitudes
            force = g + W**2 * z - (scaled * z).sum(axis=1)
            state = exact.advance_forced(state, force, force)
        u, v = state.amplitudes / root, state.velocities / root
        path.append(u.reshape(-1, 3))
    return np.stack(path)
