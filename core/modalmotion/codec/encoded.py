"""What encoding gives."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Encoded:
    """A stream and what was measured after decoding it.

    Parameters
    ----------
    data : bytes
    rms : float, length unit
        Root mean square of the distance of a vertex from its original.
    max_error : float, length unit
        Largest difference of one coordinate.
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
