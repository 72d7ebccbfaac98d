"""Search for parts of a surface that move as one, by trials of what they cost."""

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import scipy

from modalmotion.codec import temporal
from modalmotion.codec.block import MOST_PARTS, N_FUNCTIONS, Block, Parts
from modalmotion.codec.spatial_modes import OrthonormalModes
from modalmotion.representation import Floats, Ints

PRICE: Final = 0.13
"""Squared steps that a bit is worth: the slope of distortion over rate of a fine quantiser."""

MOST_PIECES: Final = 256
FINEST_PIECE: Final = 24
MOST_COMPONENTS: Final = 64
BITS_EACH: Final = 2.0
"""What a number of a part takes, roughly."""


def segmented(
    offsets: Floats, reference: int, modes: OrthonormalModes, step: float, price: float
) -> Parts | None:
    """Find the parts of a motion.

    Parameters
    ----------
    offsets : (frames, 3, vertices) float64, quanta
    reference : int
        Frame whose shape the parts are maps of.
    modes : OrthonormalModes
        Their connectivity is cut into pieces.
    step : float, quanta
    price : float
        Squared steps that a bit is worth.

    Returns
    -------
    Parts or None
        None if there is nothing to merge: without connectivity, or with too many pieces.
    """
    n = offsets.shape[2]
    finest = max(FINEST_PIECE, 2 * n // MOST_PIECES)
    pieces = modes.pieces(finest)
    if pieces is None or not 1 < len(pieces) <= MOST_PIECES:
        return None
    features = _features(offsets - offsets[reference], step)
    if not len(features):
        return None
    worth = price * step**2 * BITS_EACH * N_FUNCTIONS * len(features)
    owner = _merged(pieces, offsets[reference], features, worth)
    labels = np.empty(n, dtype=np.int64)
    for piece, label in zip(pieces, owner.tolist(), strict=True):
        labels[piece] = label
    # Whole components where they will do: fewer labels.
    whole = modes.pieces(n)
    if whole is not None and all((labels[piece] == labels[piece[0]]).all() for piece in whole):
        finest, pieces = n, whole
    # The largest part first.
    counts = np.bincount(labels)
    place = np.argsort(np.argsort(-counts, kind="stable"), kind="stable")
    told = place[np.array([labels[piece[0]] for piece in pieces])]
    count = len(counts)
    return Parts(finest, pieces, told, count) if count <= min(MOST_PARTS, n // 4) else None


def _features(moved: Floats, step: float) -> Floats:
    """Where each vertex goes: coefficients of its strongest components, (components, n)."""
    flat = moved.reshape(-1, moved.shape[2])
    if flat.shape[0] <= flat.shape[1]:
        squares, U = scipy.linalg.eigh(flat @ flat.T)
        strong = np.flatnonzero(squares > (step / 2) ** 2)[-MOST_COMPONENTS:]
        return np.ascontiguousarray(U[:, strong].T @ flat)
    squares, V = scipy.linalg.eigh(flat.T @ flat)
    strong = np.flatnonzero(squares > (step / 2) ** 2)[-MOST_COMPONENTS:]
    return np.ascontiguousarray(np.sqrt(squares[strong])[:, None] * V[:, strong].T)


def _merged(pieces: list[Ints], shape: Floats, features: Floats, worth: float) -> Ints:
    """Part of each piece, merging the two whose error grows least while it is worth less."""
    scale = float(np.abs(shape).max()) or 1.0
    about = np.concatenate([np.ones((1, shape.shape[1])), shape / scale])
    # Normal equations of the affine maps: they add up.
    G = np.array([about[:, piece] @ about[:, piece].T for piece in pieces])
    H = np.array([about[:, piece] @ features[:, piece].T for piece in pieces])
    square = np.array([(features[:, piece] ** 2).sum() for piece in pieces])
    n = len(pieces)
    own = _unexplained(G, H, square)
    growth = np.full((n, n), np.inf)
    for i in range(n - 1):
        j = slice(i + 1, n)
        both = _unexplained(G[i] + G[j], H[i] + H[j], square[i] + square[j])
        growth[i, j] = both - own[i] - own[j]
    owner, alive = np.arange(n), np.ones(n, dtype=bool)
    while True:
        a, b = divmod(int(np.argmin(growth)), n)
        if not growth[a, b] <= worth:
            break
        owner[owner == b] = a
        G[a] += G[b]
        H[a] += H[b]
        square[a] += square[b]
        own[a] += own[b] + growth[a, b]
        alive[b] = False
        growth[b], growth[:, b] = np.inf, np.inf
        k = np.flatnonzero(alive)
        k = k[k != a]
        both = _unexplained(G[a] + G[k], H[a] + H[k], square[a] + square[k])
        growth[np.minimum(a, k), np.maximum(a, k)] = both - own[a] - own[k]
    found: Ints = np.unique(owner, return_inverse=True)[1]
    return found


def _unexplained(G: Floats, H: Floats, square: Floats) -> Floats:
    """Squares that the best affine maps leave, (maps,)."""
    values, Q = np.linalg.eigh(G)
    usable = values > 1e-9 * values[:, -1:]
    inverse = np.where(usable, 1.0 / np.where(usable, values, 1.0), 0.0)
    explained = (inverse[:, :, None] * (Q.transpose(0, 2, 1) @ H) ** 2).sum(axis=(1, 2))
    left: Floats = np.maximum(square - explained, 0.0)
    return left


@dataclass(frozen=True, eq=False)
class Trial:
    """A block at some step, and the error it makes.

    Parameters
    ----------
    kind : Temporal
    quantiser : Quantiser
    basis : (components, frames x 3) int64
    coefficients : (rows, modes) int64
    squared_error : float, quanta squared
        Summed over frames and vertices.
    parts : Parts, optional
    maps : (components, 4 x parts) int64
    """

    kind: temporal.Temporal
    quantiser: temporal.Quantiser
    basis: Ints
    coefficients: Ints
    squared_error: float
    parts: Parts | None = None
    maps: Ints = field(default_factory=lambda: np.zeros((0, 0), dtype=np.int64))

    @property
    def largest(self) -> int:
        """Largest magnitude of all numbers."""
        return max(max(-int(n.min(initial=0)), int(n.max(initial=0))) for n in self._numbers)

    @property
    def cost(self) -> float:
        """Error and bits, roughly, in squared steps: what is least at one step is best."""
        bits = sum(float(rough_bits(n).sum()) for n in self._numbers if n.size)
        return self.squared_error / self.quantiser.step**2 + PRICE * bits

    @property
    def _numbers(self) -> tuple[Ints, Ints, Ints]:
        return self.basis, self.coefficients, self.maps

    def block(self, n_frames: int, exponent: int, origin: Ints, width: int = 0) -> Block:
        """Make the block, without modes that no coefficient uses."""
        n_modes = max(1, temporal.last_used(self.coefficients.any(axis=0)))
        return Block(
            self.kind,
            n_frames,
            self.quantiser,
            self.basis,
            self.coefficients[:, :n_modes],
            exponent,
            origin,
            width,
            self.parts,
            self.maps,
        )


def rough_bits(numbers: Ints) -> Floats:
    """Bits of each row, roughly: where its values are, their signs and magnitudes."""
    n = numbers.shape[1]
    occupied = np.count_nonzero(numbers, axis=1)
    share = np.maximum(occupied, 1) / n
    where = occupied * (np.log2(1.0 / share) + 1.4 * (1.0 - share))
    bits: Floats = where + occupied + 1.6 * np.log2(np.maximum(np.abs(numbers), 1)).sum(axis=1)
    return bits


def leading(used: Any) -> int:
    """Count the rows before the first that is all zero."""
    return len(used) if used.all() else int(np.argmin(used))


@dataclass(frozen=True, eq=False)
class Articulated:
    """A motion, its parts, and the shape that they are maps of.

    Parameters
    ----------
    amplitudes : (frames, 3, modes) float64, quanta
    offsets : (frames, 3, vertices) float64, quanta
    modes : OrthonormalModes
    parts : Parts
    shape : (3, modes) float64, quanta
        Amplitudes of the shape.
    """

    amplitudes: Floats
    offsets: Floats
    modes: OrthonormalModes
    parts: Parts
    shape: Floats

    def attempt(self, step: float) -> Trial | None:
        """Quantise at one step; None if it is finer than the numbers themselves.

        Parameters
        ----------
        step : float, quanta
        """
        exact = self.shape * np.sqrt(len(self.amplitudes))
        if not temporal.is_countable(exact, step):
            return None
        shape = temporal.quantise(exact, step, PRICE)
        first = self._quantised(shape, temporal.fit_quantiser(exact, shape, step), None)
        if first is None:
            return None
        # Again with one set of shifts for all numbers, and without what is not worth its bits.
        again = self._quantised(shape, first.shifted, first.n_worth)
        return None if again is None else again.trial

    def _quantised(
        self, numbers: Ints, quantiser: temporal.Quantiser, most: int | None
    ) -> "_Found | None":
        n_frames, step = len(self.amplitudes), quantiser.step
        constant = quantiser.restore(numbers) / np.sqrt(n_frames)
        shape = self.modes.synthesise(constant)
        functions = self.parts.functions(shape)
        turned = self.parts.gathered((self.offsets - shape).reshape(3 * n_frames, -1), functions)
        left = (self.amplitudes - constant).reshape(3 * n_frames, -1)

        exact_basis = temporal.basis_numbers(_components(turned, n_frames))
        if not temporal.is_countable(exact_basis, step):
            return None
        loud = np.abs(exact_basis).max(axis=1) > step / 2
        exact_basis = exact_basis[: int(np.count_nonzero(loud))][:most]
        basis = temporal.quantise(exact_basis, step, PRICE)
        basis = basis[: leading(basis.any(axis=1))]
        time_basis = temporal.restore_basis(temporal.Temporal.PARTS, basis, n_frames, quantiser)
        B = time_basis.learned.reshape(3 * n_frames, -1)

        exact_maps, exact_rows = _fitted(B, turned), _fitted(B, left)
        if not (
            temporal.is_countable(exact_maps, step) and temporal.is_countable(exact_rows, step)
        ):
            return None
        maps = temporal.quantise(exact_maps, step, PRICE)
        mapped = quantiser.restore(maps) @ self.modes.analyse(self.parts.apart(functions))
        exact_rest = exact_rows - mapped
        rest = temporal.quantise(exact_rest, step, PRICE)
        rows = mapped + quantiser.restore(rest)

        gain = (exact_rows**2 - (exact_rows - rows) ** 2).sum(axis=1) / step**2
        bits = rough_bits(basis) + rough_bits(maps) + rough_bits(rest)
        worth = np.cumsum(gain - PRICE * bits)
        pairs = (
            (self.shape * np.sqrt(n_frames), numbers),
            (exact_basis[: len(basis)], basis),
            (exact_maps, maps),
            (exact_rest, rest),
        )
        trial = Trial(
            temporal.Temporal.PARTS,
            quantiser,
            basis,
            np.concatenate([numbers, rest]),
            float(((left - B @ rows) ** 2).sum()),
            self.parts,
            maps,
        )
        shifted = temporal.fit_quantiser(
            np.concatenate([exact.ravel() for exact, _ in pairs]),
            np.concatenate([rounded.ravel() for _, rounded in pairs]),
            step,
        )
        n_worth = int(np.argmax(worth)) + 1 if len(worth) and worth.max() > 0 else 0
        return _Found(trial, shifted, n_worth)


@dataclass(frozen=True, eq=False)
class _Found:
    """A trial, the quantiser that suits all its numbers, and how many components are worth it."""

    trial: Trial
    shifted: temporal.Quantiser
    n_worth: int


def find_parts(
    amplitudes: Floats, offsets: Floats, modes: OrthonormalModes, step: float
) -> Articulated | None:
    """Look for parts that move as one; None if there are none.

    Parameters
    ----------
    amplitudes : (frames, 3, modes) float64, quanta
    offsets : (frames, 3, vertices) float64, quanta
    modes : OrthonormalModes
    step : float, quanta
    """
    # The frame nearest to the mean: a shape that occurs, unlike the mean of what turns.
    far = ((offsets - offsets.mean(axis=0)) ** 2).sum(axis=(1, 2))
    reference = int(np.argmin(far))
    parts = segmented(offsets, reference, modes, step, PRICE)
    return (
        None
        if parts is None
        else Articulated(amplitudes, offsets, modes, parts, amplitudes[reference])
    )


def _components(turned: Floats, n_frames: int) -> Floats:
    """Principal components of what the parts do, (components, frames, 3), times their strength."""
    U, strengths, _ = scipy.linalg.svd(turned, full_matrices=False)
    return np.ascontiguousarray((U * strengths).T).reshape(-1, n_frames, 3)


def _fitted(B: Floats, motion: Floats) -> Floats:
    """Find the combinations of components that leave the least error."""
    if not B.shape[1]:
        return np.zeros((0, motion.shape[1]))
    # Orthonormal up to their rounding: fitted, not projected.
    found, *_ = scipy.linalg.lstsq(B, motion, cond=temporal.ALIKE, lapack_driver="gelsy")
    return np.asarray(found)
