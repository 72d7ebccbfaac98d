"""Which pieces of a mesh move as one: merged as long as an affine map explains both."""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.codec.modes.modes_section import OrthonormalModes
from modalmotion.codec.parts.parts import MOST_PARTS, N_FUNCTIONS, Parts

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

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
        None where there is nothing to merge: without connectivity, or with too many pieces.
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
