"""Frames estimated: each at rest by itself, then all at once, joined by a chain of time.

a = argmin sum w (n . (y - x(a)))^2 / s^2 + a' K a: the place where the oscillators of (3), driven
by the force that the data exert, come to rest. Gauss-Newton goes there in a few steps, each of
which matches points and surface anew.

Frames differ from the one that the shape is taken from by a motion whose harmonic h of the cycle is
as stiff as (1 + (h / h0)^2)^2 - 1, as of a bent rod that nothing holds in its place; what this one
itself is off the shape, as far as the modes show it, all frames have in common. On frames at any
times the chain has springs of unequal length, and h^2 becomes its stiffness matrix. The chain joins
neighbours only, so the work grows as the number of frames.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from modalmotion.numeric.scales import gram, inverse_of_cholesky
from modalmotion.representation import Floats
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.noise import Noise, Prior, Residuals, most_likely_prior, noise_of
from modalmotion.tracking.normal_equations import (
    NormalEquations,
    across_covariance,
    normal_equations,
)
from modalmotion.tracking.observation import Frame

_MOST_STEPS: Final = 12

# A step of a tenth of the standard deviation in each amplitude, squared.
_SMALL: Final = 0.01


@dataclass(frozen=True, eq=False)
class FrameEstimate:
    """A frame at rest.

    Parameters
    ----------
    amplitudes : (modes, 3) float64, length unit
    information : NormalEquations
        About the shape before the last step.
    covariance : (3 modes, 3 modes) float64, length unit squared
        (A + K)^-1.
    """

    amplitudes: Floats
    information: NormalEquations
    covariance: Floats


def map_frame(
    surface: Deformable,
    frame: Frame,
    start: Floats,
    variances: Floats,
    noise: Noise,
    most_steps: int = _MOST_STEPS,
) -> FrameEstimate:
    """Find the equilibrium of one frame by Gauss-Newton.

    Parameters
    ----------
    surface : Deformable
    frame : Frame
    start : (modes, 3) float64, length unit
    variances : (modes,) float64, length unit squared
        K^-1.
    noise : Noise
    most_steps : int
    """
    stiffness = surface.stiffness(variances)
    a = start
    for _ in range(most_steps):
        found = normal_equations(surface, a, frame, noise)
        H = found.matrix + stiffness
        inverse = inverse_of_cholesky(H)
        new = (inverse.T @ (inverse @ found.vector[:, None])).reshape(-1, 3)
        change = (new - a).ravel()
        a = new
        if float(change @ (H @ change[:, None])[:, 0]) <= _SMALL * len(change):
            break
    return FrameEstimate(a, found, gram(inverse))


# Of the size: no prior is narrower. No noise is either: one point that fits exactly would weigh as
# many digits more than the prior as there are.
LEAST: Final = 1e-9
_LEAST_NOISE: Final = 1e-6

# Of the size: what points may be off the start by at first.
_FIRST_NOISE: Final = 0.02


Iteration: TypeAlias = list[FrameEstimate | None]
"""All frames at rest, each by itself; None where nothing was observed."""


def amplitudes_of(surface: Deformable, here: Iteration) -> Floats:
    """Amplitudes, (frames, modes, 3); those of a missing frame are its neighbour's."""
    full = np.zeros((len(here), len(surface), 3))
    for k, own in enumerate(here):
        full[k] = full[k - 1] if own is None else own.amplitudes
    return full


def frames_at_rest(
    surface: Deformable,
    frames: Sequence[Frame],
    prior: Prior,
    noise: Noise,
    paths: Sequence[Sequence[int]],
    done: Callable[[], object],
    starts: Floats | None = None,
) -> Iteration:
    """Estimate frame after frame along paths that all go on from the first one.

    Parameters
    ----------
    surface : Deformable
    frames : sequence of Frame
    prior : Prior
    noise : Noise
    paths : sequence of sequence of int
        As of `paths_from`.
    done : callable
        Called after each frame.
    starts : (frames, modes, 3) float64, length unit, optional
        Where frames are; by default each is where the one before it on its path is.
    """
    variances = prior.variances(surface.wavenumbers)
    found: Iteration = [None] * len(frames)
    first = a = np.zeros((len(surface), 3))
    for number, path in enumerate(paths):
        for k in path:
            if any(map(len, frames[k])):
                start = a if starts is None else starts[k]
                found[k] = own = map_frame(surface, frames[k], start, variances, noise)
                a = own.amplitudes
            done()
        a = first = first if number else a
    return found


def paths_from(first: int, n: int, *, is_closed: bool) -> tuple[list[int], ...]:
    """List the first frame, those after it, and those before; of a cycle half the way each."""
    if not is_closed:
        return [first], [*range(first + 1, n)], [*range(first - 1, -1, -1)]
    half = n // 2
    there = [(first + i) % n for i in range(1, half + 1)]
    return [first], there, [(first - i) % n for i in range(1, n - half)]


def evidence(
    surface: Deformable,
    estimates: Sequence[FrameEstimate | None],
    prior: Prior,
    *,
    is_exact: bool = True,
) -> tuple[Prior, Noise, Floats]:
    """Find the prior and the noise under which frames at rest are the most likely.

    The third is the truncation of each frame; of missing ones that of all. Where the start is
    exact, as that of a single frame, nothing is left where nothing moves.
    """
    n = len(surface)
    energies, determined = np.zeros(n), np.zeros(n)
    v = prior.variances(surface.wavenumbers)
    kept = [own for own in estimates if own is not None]
    for own in kept:
        energies += (own.amplitudes**2).sum(axis=1)
        share = 1.0 - np.diag(own.covariance).reshape(-1, 3) / v[:, None]
        determined += np.maximum(share, 0.0).sum(axis=1)
    least = LEAST * surface.size
    found = most_likely_prior(surface.wavenumbers, energies, determined, least)
    _, n_values = found.beyond(surface.wavenumbers, surface.template.topology.n_axes)
    left = [
        Residuals(
            own.information.points,
            own.information.residuals,
            own.information.weights,
            # tr (A C): the amplitudes that the data have set.
            float((own.information.matrix * own.covariance).sum()),
            _energy(surface, own, found),
        )
        for own in kept
    ]
    n_axes = surface.template.topology.n_axes
    noise, of_frames = noise_of(left, n_values, n_axes, is_exact=is_exact)
    truncations = np.full(len(estimates), noise.truncation)
    truncations[[estimate is not None for estimate in estimates]] = of_frames
    return found, replace(noise, sd=max(noise.sd, _LEAST_NOISE * surface.size)), truncations


def shape_evidence(surface: Deformable, own: FrameEstimate, prior: Prior) -> tuple[Prior, Noise]:
    """Find prior and noise of the one frame that a shape is taken from.

    What the modes leave counts as that of amplitudes as large as the prior says.
    """
    found, noise, _ = evidence(surface, [own], prior)
    energy = max(_energy(surface, own, found), LEAST)
    return found, replace(noise, truncation=noise.truncation / energy**0.5)


def _energy(surface: Deformable, own: FrameEstimate, prior: Prior) -> float:
    """Mean over modes and directions of a^2 over its prior variance, translation left out."""
    moves = surface.wavenumbers > 0
    v = prior.variances(surface.wavenumbers)[moves]
    return float((own.amplitudes[moves] ** 2 / v[:, None]).mean())


def first_guess(surface: Deformable) -> tuple[Prior, Noise]:
    """Prior and noise before anything was seen."""
    prior = Prior.broad(surface.size)
    beyond, n_values = prior.beyond(surface.wavenumbers, surface.template.topology.n_axes)
    return prior, Noise(_FIRST_NOISE * surface.size, float(np.sqrt(beyond)), n_values)


# Harmonics from which on motion is held down: that of a few frames, from which on others are tried,
# the least of these, and how many.
_USUAL: Final = 2.0
_FEW: Final = 4
_STIFFEST: Final = 0.25
_N_TRIED: Final = 24


def chain_precision(
    phases: Floats, h0: float, anchor: int, offset: float = 1.0, *, is_closed: bool
) -> Floats:
    """Precision of a chain of frames.

    Parameters
    ----------
    phases : (frames,) float64
        In cycles, increasing, from 0 to less than 1; of an open chain in lengths of it.
    h0 : float
        Harmonic from which on amplitudes are held down more.
    anchor : int
        Frame that the shape is of. By how much others differ from it has a mean variance of 1.
    offset : float
        Variance of this frame, which all others have in common.
    is_closed : bool

    Returns
    -------
    (frames, frames) float64
        Each frame joined to the two before and after it.
    """
    n = len(phases)
    if n == 1:
        return np.eye(1) / offset
    start = np.arange(n if is_closed and n > 2 else n - 1)
    end = (start + 1) % n
    gaps = np.diff(phases, append=phases[0] + 1.0)[: len(start)]
    # L of springs 1 / gap between masses M of a frame's share of time.
    springs = np.eye(n)[end] - np.eye(n)[start]
    share = np.abs(springs).T @ gaps / 2.0
    L = springs.T @ (springs / gaps[:, None]) / (2.0 * np.pi * h0) ** 2
    # (M + L) M^-1 (M + L) - M.
    Q: Floats = 2.0 * L + ((L / share) @ L)
    Q = (Q + Q.T) / 2
    others = np.delete(np.arange(n), anchor)
    inverse = inverse_of_cholesky(Q[np.ix_(others, others)])
    Q *= float((inverse**2).sum()) / (n - 1)
    Q[anchor, anchor] += 1.0 / offset
    return Q


def joined(
    matrices: Floats, vectors: Floats, stiffness: Floats, Q: Floats
) -> tuple[Floats, Floats]:
    """Estimate all frames together: (Q (x) K + A) a = b.

    Parameters
    ----------
    matrices : (frames, n, n) float64
        A, what the data of each frame say.
    vectors : (frames, n) float64
        b.
    stiffness : (n, n) float64
        K.
    Q : (frames, frames) float64
        As `chain_precision` returns it.

    Returns
    -------
    amplitudes : (frames, n) float64
    covariances : (frames, n, n) float64
        Of each frame.

    Notes
    -----
    Folded at its middle, a closed chain joins frames at most four places apart, so blocks of
    four frames form a tridiagonal system: S_i = D_i - E_i S_(i-1)^-1 E_i' forward, and
    C_i = S_i^-1 + G C_(i+1) G', G = S_i^-1 E_(i+1)', backward.
    """
    n_frames, n = vectors.shape
    # Both ways round from the first: 0, 1, n - 1, 2, n - 2, ...
    pairs = (dict.fromkeys((i, n_frames - i)) for i in range(1, n_frames // 2 + 1))
    order = [0, *(k for pair in pairs for k in pair)]
    blocks = [order[i : i + 4] for i in range(0, n_frames, 4)]
    amplitudes, covariances = np.empty((n_frames, n)), np.empty((n_frames, n, n))

    def between(i: int, j: int) -> Floats:
        return np.asarray(np.kron(Q[np.ix_(blocks[i], blocks[j])], stiffness), dtype=np.float64)

    inverses, sums = list[Floats](), list[Floats]()
    for i, block in enumerate(blocks):
        D, b = between(i, i), vectors[block].ravel()
        for k, frame in enumerate(block):
            D[k * n : (k + 1) * n, k * n : (k + 1) * n] += matrices[frame]
        if i:
            F = between(i, i - 1) @ inverses[-1]
            D -= F @ between(i - 1, i)
            b = b - (F @ sums[-1][:, None])[:, 0]
        inverses.append(gram(inverse_of_cholesky((D + D.T) / 2)))
        sums.append(b)
    a, C = np.zeros(0), np.zeros((0, 0))
    for i in range(len(blocks) - 1, -1, -1):
        inverse = inverses[i]
        own = (inverse @ sums[i][:, None])[:, 0]
        if i + 1 < len(blocks):
            G = inverse @ between(i, i + 1)
            own = own - (G @ a[:, None])[:, 0]
            inverse = inverse + ((G @ C) @ G.T)
        a, C = own, (inverse + inverse.T) / 2
        for k, frame in enumerate(blocks[i]):
            rows = slice(k * n, (k + 1) * n)
            amplitudes[frame], covariances[frame] = a[rows], C[rows, rows]
    return amplitudes, covariances


# Prior variances over that of a frame whose surface is known.
_PINNED: Final = 1e8

# Of the variance of the motion: no shape is known better.
_LEAST_OFFSET: Final = 1e-3


def chain_of(
    surface: Deformable,
    here: Iteration,
    prior: Prior,
    phases: Floats,
    reference: int,
    *,
    is_closed: bool,
    is_exact: bool,
) -> tuple[Floats, Prior]:
    """Find the precision of the chain of frames, (frames, frames), and the prior along it.

    Frames differ from the reference by their motion, which is held down from the harmonic on under
    which it is the most likely. What the shape is off, unless it is exact, the reference shows, and
    all frames have it.
    """
    sds = np.sqrt(prior.variances(surface.wavenumbers))[:, None]
    kept = {k: own for k, own in enumerate(here) if own is not None}
    own = {k: (one.amplitudes / sds).ravel() for k, one in kept.items()}
    covariance = np.mean([np.diag(o.covariance).reshape(-1, 3) for o in kept.values()], axis=0)
    shares = np.clip(1.0 - covariance / sds**2, 0.0, 1.0).ravel()
    offset, total = 1.0, float(shares.sum())
    if is_exact:
        # It is at rest, with data or without.
        own[reference] = np.zeros(3 * len(surface))
    seen = sorted(own)
    scaled = np.stack([own[k] for k in seen])
    row = seen.index(reference) if reference in seen else 0
    free, variance, harmonic, least = np.delete(np.arange(len(seen)), row), 1.0, _USUAL, np.inf
    tried = np.geomspace(_STIFFEST, len(seen) / 4.0, _N_TRIED).tolist()
    x = scaled[free] - scaled[row]
    for h0 in (tried if len(seen) >= _FEW else [_USUAL]) if len(free) and total > 0 else []:
        Q = chain_precision(phases[seen], h0, row, is_closed=is_closed)[np.ix_(free, free)]
        # Variance by which the others differ from it, instead of 1; -2 log of the likelihood.
        energy = float((shares * (x * (Q @ x)).sum(axis=0)).sum()) / total / len(free)
        unlikely = len(free) * np.log(max(energy, 1e-300)) - np.linalg.slogdet(Q)[1]
        if unlikely < least:
            harmonic, variance, least = h0, energy, unlikely
    if not is_exact and reference in seen and len(seen) > 1 and total > 0:
        offset = float((shares * scaled[row] ** 2).sum()) / total / max(variance, 1e-300)
    wide, narrowest = float(np.sqrt(variance)), LEAST * surface.size
    # Where nothing moves at all a variance of zero would have no inverse.
    scale, drift = max(prior.scale * wide, narrowest), max(prior.drift * wide, narrowest)
    along = replace(prior, scale=scale, drift=drift)
    offset = max(offset, _LEAST_OFFSET)
    return chain_precision(phases, harmonic, reference, offset, is_closed=is_closed), along


class FramesEstimate(NamedTuple):
    """All frames estimated at once.

    Parameters
    ----------
    amplitudes : (frames, modes, 3) float64, length unit
    prior : Prior
        Along the chain.
    across : (frames, 3 modes, 3 modes) float64, length unit squared
        Covariances across the surface; none where it is known.
    information : list of NormalEquations
    lasting : (frames, 3 modes, 3 modes) float64, length unit squared
        Covariances, where frames that see the same truncation count as one.
    """

    amplitudes: Floats
    prior: Prior
    across: Floats
    information: list[NormalEquations]
    lasting: Floats


def map_frames(
    surface: Deformable,
    frames: Sequence[Frame],
    here: Iteration,
    chain: tuple[Floats, Prior],
    noise: Noise,
    pinned: int | None,
    done: Callable[[], object],
) -> FramesEstimate:
    """Estimate all frames at once, twice, the second time about the first result."""
    (Q, prior), n_frames, m = chain, len(frames), len(surface)
    stiffness = surface.stiffness(prior.variances(surface.wavenumbers))
    a = amplitudes_of(surface, here)
    seen, last = np.empty(0), list[NormalEquations]()
    for _ in range(2):
        last = []
        for k, frame in enumerate(frames):
            last.append(normal_equations(surface, a[k], frame, noise))
            done()
        matrices, vectors = _stacked(last, stiffness, pinned)
        flat, seen = joined(matrices, vectors, stiffness, Q)
        a = flat.reshape(n_frames, m, 3)
    # What the modes leave lasts: frames nearer than the chain is long see the same of it, and do
    # not count as often as there are frames. What looks like sliding is what lies next beyond the
    # modes, where the most of it is.
    covariance = gram(inverse_of_cholesky(Q))
    spread = np.sqrt(np.diag(covariance))
    correlation = covariance / spread / spread[:, None]
    lasting = max(1.0, float((correlation**2).sum()) / n_frames)
    lasting *= prior.concentration(surface.template.topology.n_axes)
    longer = replace(noise, truncation=noise.truncation * float(np.sqrt(lasting)))
    slow = [normal_equations(surface, a[k], frame, longer) for k, frame in enumerate(frames)]
    matrices, vectors = _stacked(slow, stiffness, pinned)
    _, covariances = joined(matrices, vectors, stiffness, Q)
    across = np.stack([across_covariance(seen[k], info) for k, info in enumerate(last)])
    if pinned is not None:
        across[pinned] = 0.0
    return FramesEstimate(a, prior, across, last, covariances)


def _stacked(
    infos: Sequence[NormalEquations], stiffness: Floats, pinned: int | None
) -> tuple[Floats, Floats]:
    """Matrices and vectors of all frames; a pinned one holds all of its amplitudes at zero."""
    matrices = np.stack([info.matrix for info in infos])
    vectors = np.stack([info.vector for info in infos])
    if pinned is not None:
        matrices[pinned] = _PINNED * stiffness
        vectors[pinned] = 0.0
    return matrices, vectors
