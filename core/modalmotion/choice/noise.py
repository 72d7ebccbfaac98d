"""The measurement's noise, estimated from a sequence itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import brentq

from modalmotion.choice.fitter import Fitter
from modalmotion.choice.nested_sets import Ladder
from modalmotion.fit.fit import Fit
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import shown

# Modes that are taken out of the motion first, and their largest share of the vertices.
_MODES: Final = 120
_SHARE: Final = 4

# Largest number of vertices and frames used; more do not change the estimate.
_MOST_VERTICES: Final = 4000
_MOST_FRAMES: Final = 400

# With fewer frames fine motion and noise look alike.
FEW_FRAMES: Final = 6


@shown()
@dataclass(frozen=True)
class Noise:
    """Noise of each coordinate of each vertex in each frame.

    Parameters
    ----------
    sigma : float, length unit
        Standard deviation, `rounding` at least.
    rounding : float, length unit
        Noise from storing the coordinates in their type.
    modes : int
        Spatial modes that were taken out first.
    rank, n_values : int
        Rank of the singular value used, counted from the smallest, and their number.
    """

    sigma: float
    rounding: float
    modes: int
    rank: int
    n_values: int

    def note(self, unit: str | None) -> str:
        """Describe the estimate and its method."""
        size = f"{self.sigma:.3g} {unit or 'length units'}"
        if self.sigma <= self.rounding:
            return (
                f"The noise is that of the stored numbers, {size} a coordinate; no other shows, so "
                "modes are added until they describe rounding. Ask by tolerance for fewer."
            )
        if not self.n_values:
            return f"One frame is too few to estimate noise; {size} was assumed."
        text = (
            f"The noise was estimated at {size} a coordinate (standard deviation): of what "
            f"{self.modes} modes leave, the singular value over time of rank {self.rank + 1} of "
            f"{self.n_values}, against that of pure noise."
        )
        if self.n_values + 1 < FEW_FRAMES:
            text += " With so few frames fine motion may count as noise."
        return text


def estimate_noise(fitter: Fitter, ladder: Ladder, fit: Fit) -> Noise:
    """Estimate independent noise of equal size in every coordinate.

    The residual motion after many modes is fine and, in time, takes few directions; noise takes
    all alike. Subtracting each vertex's mean over time takes out the reference's own noise,
    which all displacements share. The median singular value of the rest is then that of
    noise (Gavish and Donoho, The optimal hard threshold for singular values is 4/sqrt(3),
    IEEE Transactions on Information Theory, 2014), for any motion over time.

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
    n_weighted = int((template.weights > 0).sum())
    n_modes = max(1, min(_MODES, n_weighted // _SHARE))
    m = int(ladder.counts[np.searchsorted(ladder.counts, n_modes, side="right") - 1])
    if sequence.n_frames < 2 or n_weighted <= m:
        return Noise(rounding, rounding, m, 0, 0)
    r = _residual(fitter, ladder, fit, m)
    scale = float(np.abs(r).max(initial=0.0))
    if scale == 0.0:
        return Noise(rounding, rounding, m, 0, 0)
    f, n = r.shape
    r = r / scale
    r -= r.mean(axis=0)
    gram = r @ r.T if f <= n else r.T @ r
    values = np.sqrt(np.maximum(np.linalg.eigvalsh(gram), 0.0))
    # The mean over time takes one direction, the modes their share of the others.
    free = round(n * (1.0 - m / n_weighted))
    n_values, most = min(f - 1, free), max(f - 1, free)
    values = values[len(values) - n_values :]
    rank = (n_values - 1) // 2
    expected = _marchenko_pastur((rank + 0.5) / n_values, n_values / most)
    sigma = scale * float(values[rank]) / np.sqrt(most * expected)
    return Noise(max(float(sigma), rounding), rounding, m, rank, n_values)


def _residual(fitter: Fitter, ladder: Ladder, fit: Fit, m: int) -> NDArray[np.float64]:
    """Take the first m modes out, in units of its noise where the coordinates' is 1.

    Returns
    -------
    (frames, 3 * vertices) float64, length unit
    """
    sequence, weights = fitter.sequence, fitter.template.weights
    counted = np.flatnonzero(weights > 0)
    some = counted[:: -(-len(counted) // _MOST_VERTICES)]
    frames = np.arange(0, sequence.n_frames, -(-sequence.n_frames // _MOST_FRAMES))
    basis = ladder.basis
    # Orthonormal shapes psi = Phi R^-1 and coefficients c = R a.
    c = basis.triangle[:m] @ fit.amplitudes[frames]
    rows = basis.triangle[:m] @ basis.projector[:, counted]
    psi = rows.T / weights[counted, None]
    gram = (psi * weights[counted, None] ** 2).T @ psi
    at = np.searchsorted(counted, some)
    # r = e - psi psi'W e: variance 1 - 2 w |psi|^2 + psi' (sum w^2 psi psi') psi
    own = psi[at]
    left = 1.0 - 2.0 * weights[some] * (own**2).sum(axis=1)
    left += ((own @ gram) * own).sum(axis=1)
    blocks = fitter.displacements.blocks()
    u = np.concatenate([block.shape.scale * block.u[:, :, some] for block in blocks])
    u = u[frames].transpose(0, 2, 1)
    r = u - own @ c
    share = 1.0 - m / len(counted)
    r *= np.sqrt(share / np.maximum(left, 0.1 * share))[:, None]
    flat: NDArray[np.float64] = r.reshape(len(r), -1)
    return flat


def _rounding(sequence: MeshSequence) -> float:
    """Give the standard deviation that rounding to the stored type adds to a coordinate."""
    largest = float(np.abs(sequence.vertices).max(initial=0.0))
    step = float(np.spacing(sequence.vertices.dtype.type(largest)))
    return step / float(np.sqrt(12.0))


def _marchenko_pastur(q: float, beta: float) -> float:
    """Quantile of the eigenvalues of noise of variance 1, beta rows for each column.

    Marchenko and Pastur, Distribution of eigenvalues for some sets of random matrices,
    Mathematics of the USSR-Sbornik, 1967.
    """
    low, high = (1.0 - np.sqrt(beta)) ** 2, (1.0 + np.sqrt(beta)) ** 2

    def share(t: float) -> float:
        # x = low + (high - low) sin^2(t / 2) takes the roots' ends out of the integrand.
        def density(angle: float) -> float:
            x = low + (high - low) * np.sin(angle / 2) ** 2
            return float(
                ((high - low) * np.sin(angle) / 2) ** 2 / (2 * np.pi * beta * max(x, 1e-300))
            )

        return float(quad(density, 0.0, t, limit=200)[0])

    angle = brentq(lambda t: share(t) - q, 0.0, np.pi)
    return float(low + (high - low) * np.sin(angle / 2) ** 2)
