"""All frames estimated at once, joined by the chain of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.numeric.cholesky import gram, inverse_of_cholesky
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.driven_frames import DrivenFrames, drive_frames
from modalmotion.tracking.information import Information, information
from modalmotion.tracking.noise import Noise
from modalmotion.tracking.observation import Frame
from modalmotion.tracking.passes import LEAST, Pass
from modalmotion.tracking.prior import Prior
from modalmotion.tracking.time_chain import chain_precision, joined, most_likely_h0

# Fewer squares than these say next to nothing of a variance.
_LEAST_NU: Final = 4.0

# Prior variances over that of a frame whose surface is known.
_PINNED: Final = 1e8


def chain_of(
    surface: Deformable,
    here: Pass,
    prior: Prior,
    phases: NDArray[np.float64],
    *,
    is_closed: bool,
    pinned: int | None,
    first: int = 0,
) -> tuple[NDArray[np.float64], float, Prior]:
    """Find the precision of the chain of frames, its harmonic h0, and the prior along it."""
    sds = np.sqrt(prior.variances(surface.wavenumbers))[:, None]
    seen = [k for k, own in enumerate(here.frames) if own is not None]
    kept = [own for own in here.frames if own is not None]
    scaled = np.stack([(own.amplitudes / sds).ravel() for own in kept])
    covariance = np.mean([np.diag(own.covariance).reshape(-1, 3) for own in kept], axis=0)
    shares = np.clip(1.0 - covariance / sds**2, 0.0, 1.0).ravel()
    row = seen.index(first) if first in seen else None
    offset = 0.0
    if pinned is None and row is not None:
        offset = float((shares * scaled[row] ** 2).sum() / max(shares.sum(), 1e-300))
        scaled = scaled - scaled[row]
    h0, variance = most_likely_h0(scaled, shares, phases[seen], is_closed=is_closed, pinned=row)
    wide, least = float(np.sqrt(variance)), LEAST * surface.size
    # Where nothing moves at all a variance of zero would have no inverse.
    scale, drift = max(prior.scale * wide, least), max(prior.drift * wide, least)
    along = replace(prior, scale=scale, drift=drift)
    Q = chain_precision(phases, h0, is_closed=is_closed)
    if pinned is None:
        C = np.linalg.inv(Q)
        C -= np.outer(C[:, first], C[first]) / C[first, first]
        C[first, first] = 0.0
        import os
        if os.environ.get('SHOW'): print('h0',h0.__round__(2),'var',round(variance,2),'offset',round(offset,3))
        offset = max(offset / max(variance,1e-300), 1e-3)
        Q = np.linalg.inv(C + offset + 1e-6*np.eye(len(C)))
        Q = (Q+Q.T)/2
    return Q, h0, along


class Together(NamedTuple):
    """All frames estimated at once."""

    amplitudes: NDArray[np.float64]
    seen: NDArray[np.float64]
    information: list[Information]
    lasting: NDArray[np.float64]
    driven: DrivenFrames | None


def together(
    surface: Deformable,
    frames: Sequence[Frame],
    here: Pass,
    prior: Prior,
    noises: Sequence[Noise],
    Q: NDArray[np.float64],
    pinned: int | None,
    done: Callable[[], None],
    *,
    dynamics: bool = False,
) -> Together:
    """Estimate all frames at once, twice, the second time about the first result.

    With `dynamics` oscillators go to the second result, from the start's shape.
    """
    n_frames, m = len(frames), len(surface)
    stiffness = np.repeat(1.0 / prior.variances(surface.wavenumbers), 3)
    a = here.amplitudes(m)
    seen, last = np.empty(0), list[Information]()
    driven: DrivenFrames | None = None
    for _ in range(2):
        last = []
        for k, frame in enumerate(frames):
            last.append(information(surface, a[k], frame, noises[k]))
            done()
        matrices, vectors = _stacked(last, stiffness, pinned)
        flat, seen = joined(matrices, vectors, stiffness, Q)
        a = flat.reshape(n_frames, m, 3)
    if dynamics:
        driven = drive_frames(matrices, vectors, stiffness, Q, np.zeros_like(vectors), pinned)
        a = driven.path[-1].reshape(n_frames, m, 3)
    # What the modes leave lasts: frames nearer than the chain is long see the same of it, and do
    # not count as often as there are frames. What looks like sliding is what lies next beyond the
    # modes, where the most of it is.
    correlation = gram(inverse_of_cholesky(Q))
    lasting = max(1.0, float((correlation**2).sum()) / n_frames)
    lasting *= prior.concentration(surface.template.topology.n_axes)
    # Squares add up, whatever most of them are.
    lasting *= max(own.peak for own in noises) ** 2
    slow = [
        information(surface, a[k], frame, noises[k].longer(lasting))
        for k, frame in enumerate(frames)
    ]
    # What nothing shows is as large as the prior says, whose scale is not exactly known.
    wide = stiffness / doubt_of_scale(surface, here, prior)
    matrices, vectors = _stacked(slow, wide, pinned)
    _, covariances = joined(matrices, vectors, wide, Q)
    return Together(a, seen, last, covariances, driven)


def doubt_of_scale(surface: Deformable, here: Pass, prior: Prior) -> float:
    """Give the variance of an amplitude that nothing shows, over that of the prior, 1 or more.

    Parameters
    ----------
    surface : Deformable
    here : Pass
        Amplitudes that the prior's scale was found from.
    prior : Prior

    Notes
    -----
    The scale is a mean of squares u of amplitudes over their variances, over frames, each mode and
    direction counted by the share s that the data have set. Amplitudes of a mode are alike in all
    frames, and few of them are large, so the variance of that mean is taken from how they differ,
    sum s^2 (u - mean)^2 / (sum s)^2, and is that of nu = 2 mean^2 / variance squares. Then an
    amplitude has Student's distribution of nu, of the variance nu / (nu - 2).
    """
    moves = surface.wavenumbers > 0
    variances = prior.variances(surface.wavenumbers)[moves, None]
    kept = [own for own in here.frames if own is not None]
    squares = np.mean([own.amplitudes[moves] ** 2 / variances for own in kept], axis=0).ravel()
    left = np.mean([np.diag(own.covariance).reshape(-1, 3)[moves] for own in kept], axis=0)
    shares = np.clip(1.0 - left / variances, 0.0, 1.0).ravel()
    total = float(shares.sum())
    mean = float((shares * squares).sum()) / total if total > 0 else 0.0
    if not mean > 0:
        return 1.0
    spread = float((shares**2 * (squares - mean) ** 2).sum()) / total**2
    nu = max(2.0 * mean**2 / max(spread, 1e-300), _LEAST_NU)
    return nu / (nu - 2.0)


def _stacked(
    infos: Sequence[Information], stiffness: NDArray[np.float64], pinned: int | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Matrices and vectors of all frames; a pinned one holds all of its amplitudes at zero."""
    matrices = np.stack([info.matrix for info in infos])
    vectors = np.stack([info.vector for info in infos])
    if pinned is not None:
        matrices[pinned] = np.diag(_PINNED * stiffness)
        vectors[pinned] = 0.0
    return matrices, vectors
