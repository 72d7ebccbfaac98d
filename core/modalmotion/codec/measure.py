"""Errors of decoded vertices."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from modalmotion.arguments.tasks import Saved
from modalmotion.mesh.checks import FloatArray
from modalmotion.representation import shown


@dataclass(frozen=True)
class Errors:
    """Errors of a sequence against its original.

    Parameters
    ----------
    rms : float, length unit
        sqrt(mean over frames and vertices of |v - v'|^2).
    max_error : float, length unit
        max |v - v'|.
    kg_error : float, percent
        100 |A - A'| / |A - E|, E the centroid of each frame (Karni and Gotsman, Compression of
        soft-body animation sequences, Computers & Graphics, 2004).
    """

    rms: float
    max_error: float
    kg_error: float


def measure(original: FloatArray, decoded: FloatArray) -> Errors:
    """Compare two arrays of positions, (frames, vertices, 3)."""
    scale = 2.0 ** float(np.clip(_exponent(original), -1000, 1000))
    squares = spread = largest = 0.0
    for a, b in zip(original, decoded, strict=True):
        exact = a.astype(np.float64) / scale
        with np.errstate(over="ignore", invalid="ignore"):
            far = ((b.astype(np.float64) / scale - exact) ** 2).sum(axis=1)
            squares += float(far.sum())
            largest = max(largest, float(far.max()))
        spread += float(((exact - exact.mean(axis=0)) ** 2).sum())
    n = original.shape[0] * original.shape[1]
    kg_error = 100.0 * math.sqrt(squares / spread) if spread > 0 else 0.0
    return Errors(math.sqrt(squares / n) * scale, math.sqrt(largest) * scale, kg_error)


def _exponent(original: FloatArray) -> int:
    return int(np.frexp(max(float(np.abs(frame).max()) for frame in original))[1])


@shown("n_frames", "n_vertices", "n_bytes", "rms", "max_error", "kg_error", "transform")
@dataclass(frozen=True)
class Encoded(Saved):
    """A stream and what was measured after decoding it.

    Parameters
    ----------
    data : bytes
    rms : float, length unit
        Root mean square of the distances of vertices from their originals, over all of them and
        all frames.
    max_error : float, length unit
        Largest distance of a vertex from its original in any frame.
    kg_error : float, percent
        100 |A - A'| / |A - E|, E the centroid of each frame; 0 where no frame extends.
    n_frames, n_vertices : int
    transform : str
        Modes and temporal components that were chosen.
    """

    data: bytes
    rms: float
    max_error: float
    kg_error: float
    n_frames: int
    n_vertices: int
    transform: str

    @property
    def n_bytes(self) -> int:
        """Bytes of the whole stream."""
        return len(self.data)

    @property
    def bits_per_vertex_and_frame(self) -> float:
        """Bits of the whole stream over vertices and frames."""
        return 8.0 * len(self.data) / (self.n_frames * self.n_vertices)
