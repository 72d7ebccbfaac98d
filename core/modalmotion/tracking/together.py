"""All frames estimated at once, joined by the chain of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.numeric.cholesky import gram, inverse_of_cholesky
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.information import Information, information
from modalmotion.tracking.noise import Noise
from modalmotion.tracking.observation import Frame
from modalmotion.tracking.passes import LEAST, Pass
from modalmotion.tracking.prior import Prior
from modalmotion.tracking.time_chain import chain_precision, joined, most_likely_h0

# Prior variances over that of a frame whose surface is known.
_PINNED: Final = 1e8

# Of the variance of the motion: no shape is known better.
_LEAST_OFFSET: Final = 1e-3


def chain_of(
    surface: Deformable,
    here: Pass,
    prior: Prior,
    phases: NDArray[np.float64],
    reference: int,
    *,
    is_closed: bool,
    is_exact: bool,
) -> tuple[NDArray[np.float64], float, Prior]:
    """Find the precision of the chain of frames, its harmonic h0, and the prior along it.

    Frames differ from the reference by their motion. What the shape is off, unless it is exact, the
    reference shows, and all frames have it.
    """
    sds = np.sqrt(prior.variances(surface.wavenumbers))[:, None]
    seen = [k for k, own in enumerate(here.frames) if own is not None]
    kept = [own for own in here.frames if own is not None]
    scaled = np.stack([(own.amplitudes / sds).ravel() for own in kept])
    covariance = np.mean([np.diag(own.covariance).reshape(-1, 3) for own in kept], axis=0)
    shares = np.clip(1.0 - covariance / sds**2, 0.0, 1.0).ravel()
    offset, total = 1.0, float(shares.sum())
    if is_exact:
        # It is at rest, with data or without.
        rest = np.zeros((len(here.frames), scaled.shape[1]))
        rest[seen] = scaled
        rest[reference] = 0.0
        seen = sorted({*seen, reference})
        scaled = rest[seen]
    row = seen.index(reference) if reference in seen else 0
    h0, variance = most_likely_h0(scaled, shares, phases[seen], row, is_closed=is_closed)
    if not is_exact and reference in seen and len(seen) > 1 and total > 0:
        offset = float((shares * scaled[row] ** 2).sum()) / total / max(variance, 1e-300)
    wide, least = float(np.sqrt(variance)), LEAST * surface.size
    # Where nothing moves at all a variance of zero would have no inverse.
    scale, drift = max(prior.scale * wide, least), max(prior.drift * wide, least)
    along = replace(prior, scale=scale, drift=drift)
    offset = max(offset, _LEAST_OFFSET)
    return chain_precision(phases, h0, reference, offset, is_closed=is_closed), h0, along


class Together(NamedTuple):
    """All frames estimated at once."""

    amplitudes: NDArray[np.float64]
    seen: NDArray[np.float64]
    information: list[Information]
    lasting: NDArray[np.float64]


def together(
    surface: Deformable,
    frames: Sequence[Frame],
    here: Pass,
    prior: Prior,
    noises: Sequence[Noise],
    Q: NDArray[np.float64],
    pinned: int | None,
    done: Callable[[], None],
) -> Together:
    """Estimate all frames at once, twice, the second time about the first result."""
    n_frames, m = len(frames), len(surface)
    stiffness = np.repeat(1.0 / prior.variances(surface.wavenumbers), 3)
    a = here.amplitudes(m)
    seen, last = np.empty(0), list[Information]()
    for _ in range(2):
        last = []
        for k, frame in enumerate(frames):
            last.append(information(surface, a[k], frame, noises[k]))
            done()
        matrices, vectors = _stacked(last, stiffness, pinned)
        flat, seen = joined(matrices, vectors, stiffness, Q)
        a = flat.reshape(n_frames, m, 3)
    # What the modes leave lasts: frames nearer than the chain is long see the same of it, and do
    # not count as often as there are frames. What looks like sliding is what lies next beyond the
    # modes, where the most of it is.
    chain = gram(inverse_of_cholesky(Q))
    spread = np.sqrt(np.diag(chain))
    correlation = chain / spread / spread[:, None]
    lasting = max(1.0, float((correlation**2).sum()) / n_frames)
    lasting *= prior.concentration(surface.template.topology.n_axes)
    # Squares add up, whatever most of them are.
    lasting *= max(own.peak for own in noises) ** 2
    slow = [
        information(surface, a[k], frame, noises[k].longer(lasting))
        for k, frame in enumerate(frames)
    ]
    matrices, vectors = _stacked(slow, stiffness, pinned)
    _, covariances = joined(matrices, vectors, stiffness, Q)
    return Together(a, seen, last, covariances)


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
