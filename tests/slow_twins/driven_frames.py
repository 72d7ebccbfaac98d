"""All frames driven to rest at once, by equation (3), in place of solving for where they rest.

The frames are joined by the chain of time, so that (3) reads M u'' + C u' + (Q (x) K) u = b - A u:
its modes are the chain's own, q, times those of the surface. Masses are chosen for each mode of
the chain, M = A_mean + q K, so that all oscillators are about as fast; they get the same frequency
W, and critical damping, and the force what that adds, with z = M^1/2 u and H = M^-1/2 (A + Q (x) K)
M^-1/2:

    z'' + 2 W z' + W^2 z = g + (W^2 - H) z,     at rest at H z = g as before.

Along an eigenvector of H, of eigenvalue e <= W^2, a step of length h takes z and z' through a
matrix with

    determinant  D = B (1 - e S) + e G^2,     trace  T = 1 - e S + B,

B, S and G the responses of the oscillator without data (`dynamics.kernel`): with x = W h,
W^2 S = 1 - (1 + x) e^-x, B = (1 - x) e^-x and G = h e^-x. D is linear in e, (1 - x) e^-x at e = 0
and e^-2x at e = W^2, so |D| < 1; and 1 - T + D = e (S (1 - B) + G^2) > 0,
1 + T + D = (2 - e S)(1 + B) + e G^2 > 0. By Jury's conditions both roots lie inside the circle:
with W^2 no less than the largest eigenvalue of H every step is stable, however long.

Such a bound is 1 + c, c the largest eigenvalue over the frames of A_f against A_mean + q_min K:
A_f + q K <= (c + 1) (A_mean + q K), as q_min <= q. So steps of 4 / W, a few hundred, end within
rounding of the equilibrium. (Equation numbers are those of Nastar, 1994.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ToleranceError
from modalmotion.modes import Oscillators, State, exact_step
from modalmotion.numeric.scales import inverse_of_cholesky

STEP: Final = 4.0
"""Length of a step, in units of 1 / W."""

# Of the force that is left, over that of the data.
_AT_REST: Final = 1e-9
_MOST_STEPS: Final = 20_000


@dataclass(frozen=True, eq=False)
class DrivenFrames:
    """Frames on their way to rest.

    Parameters
    ----------
    path : (snapshots, frames, 3 modes) float64, length unit
        At the start, after 1, 2, 4, 8, ... steps, and at rest.
    steps : tuple of int
        Of each snapshot.
    frequency : float
        W, per unit of the oscillators' own time.
    """

    path: NDArray[np.float64]
    steps: tuple[int, ...]
    frequency: float


def drive_frames(
    matrices: NDArray[np.float64],
    vectors: NDArray[np.float64],
    stiffness: NDArray[np.float64],
    Q: NDArray[np.float64],
    start: NDArray[np.float64],
    pinned: int | None,
) -> DrivenFrames:
    """Let the force of all frames' data drive them until they rest.

    Parameters
    ----------
    matrices : (frames, n, n) float64
        A, of the data.
    vectors : (frames, n) float64
        b.
    stiffness : (n, n) float64
        K.
    Q : (frames, frames) float64
        Precision of the chain of time.
    start : (frames, n) float64, length unit
        Where they are still at first.
    pinned : int or None
        Frame that is held at zero.

    Returns
    -------
    DrivenFrames

    Raises
    ------
    ToleranceError
        If they do not rest after 20,000 steps.
    """
    n_frames, n = vectors.shape
    loose = np.arange(n_frames) != pinned
    has_data = matrices.any(axis=(1, 2))
    free, empty = np.flatnonzero(loose & has_data), np.flatnonzero(loose & ~has_data)
    A, b = matrices[free], vectors[free]
    # Frames without data rest where the chain holds them: they follow, and the chain of the others
    # is the stiffer for it. As oscillators of their own they would be far slower than all others.
    follow = -np.linalg.solve(Q[np.ix_(empty, empty)], Q[np.ix_(empty, free)])
    q, U = np.linalg.eigh(Q[np.ix_(free, free)] + Q[np.ix_(free, empty)] @ follow)
    mean = A.mean(axis=0)
    roots = np.stack([inverse_of_cholesky(mean + h * stiffness) for h in q])
    # c: A_f against the softest mass.
    W = float(np.sqrt(1.0 + max(_largest(roots[0] @ one, roots[0]) for one in A)))

    def amplitudes(z: NDArray[np.float64]) -> NDArray[np.float64]:
        turned: NDArray[np.float64] = np.einsum("hji,hj->hi", roots, z)
        return U @ turned

    def forces(of_frames: NDArray[np.float64]) -> NDArray[np.float64]:
        of_modes = U.T @ of_frames
        result: NDArray[np.float64] = np.einsum("hij,hj->hi", roots, of_modes)
        return result

    def pull(u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Force of data and chain on each frame, b - A u - Q K u."""
        chain = (U @ (q[:, None] * (U.T @ u))) @ stiffness
        left: NDArray[np.float64] = b - np.einsum("fij,fj->fi", A, u) - chain
        return left

    size = len(free) * n
    exact = exact_step(Oscillators(np.full(size, W), 2.0 * W), STEP / W)
    u = start[free]
    # z = M^1/2 u: where roots are M^-1/2, the masses' own products with it.
    masses = mean[None] + q[:, None, None] * stiffness
    of_modes = U.T @ u
    z = np.einsum("hij,hj->hi", roots, np.einsum("hij,hj->hi", masses, of_modes)).ravel()
    state, shots, steps, done = State(z, np.zeros(size)), [u], [0], 0
    # Where they begin at rest already, nothing but rounding is left.
    whole = float(np.linalg.norm(forces(b)))
    left = float(np.linalg.norm(forces(pull(u))))
    while left > _AT_REST * whole:
        if done == _MOST_STEPS:
            raise ToleranceError(
                f"The frames are not at rest after {done:,} steps ({left / whole:.1e} of the force "
                "is left).",
                remedy="Ask for fewer modes.",
                details={"steps": done, "left": left / whole},
            )
        u = amplitudes(state.amplitudes.reshape(len(q), n))
        force = forces(pull(u)).ravel() + W**2 * state.amplitudes
        state = exact.advance(state, force, force)
        done += 1
        u = amplitudes(state.amplitudes.reshape(len(q), n))
        left = float(np.linalg.norm(forces(pull(u))))
        if done & (done - 1) == 0:
            shots.append(u)
            steps.append(done)
    if steps[-1] != done:
        shots.append(u)
        steps.append(done)
    path = np.zeros((len(shots), n_frames, n))
    path[:, free] = np.stack(shots)
    path[:, empty] = np.einsum("ef,kfi->kei", follow, path[:, free])
    return DrivenFrames(path, tuple(steps), W)


def _largest(half: NDArray[np.float64], root: NDArray[np.float64]) -> float:
    """Largest eigenvalue of L^-1 A L^-T, of L^-1 A and L^-1."""
    scaled = half @ root.T
    return float(np.linalg.eigvalsh(scaled)[-1])
