"""Noise that is smooth over a surface and in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array

from modalmotion.mesh.sequence import MeshSequence
from modalmotion.template import make_template


def with_noise(
    sequence: MeshSequence,
    sigma: float,
    rng: np.random.Generator,
    mixed: int = 0,
    correlation: float = 0.0,
) -> MeshSequence:
    """Add normal noise to a sequence.

    Parameters
    ----------
    sequence : MeshSequence
    sigma : float, length unit
        Deviation per coordinate, after mixing.
    rng : numpy.random.Generator
    mixed : int
        Times that each vertex is replaced by the mean of itself and its neighbours.
    correlation : float
        Of a frame's noise with the next frame's: an autoregression of order 1.
    """
    f, n = sequence.n_frames, sequence.n_vertices
    noise = rng.standard_normal((f, n, 3))
    for k in range(1, f):
        noise[k] = correlation * noise[k - 1] + np.sqrt(1 - correlation**2) * noise[k]
    if mixed:
        mixing = _mixing(make_template(sequence).faces, n)
        for _ in range(mixed):
            noise = np.stack([mixing @ frame for frame in noise])
    noise *= sigma / np.sqrt((noise**2).mean())
    return replace(sequence, vertices=sequence.vertices + noise)


def _mixing(faces: NDArray[np.int64], n: int) -> coo_array:
    i = np.concatenate([np.arange(n), faces[:, [0, 1, 2, 1, 2, 0]].ravel()])
    j = np.concatenate([np.arange(n), faces[:, [1, 2, 0, 0, 1, 2]].ravel()])
    pairs = np.unique(np.stack([i, j]), axis=1)
    counts = np.bincount(pairs[0], minlength=n)
    return coo_array((1.0 / counts[pairs[0]], (pairs[0], pairs[1])), shape=(n, n)).tocsr()
