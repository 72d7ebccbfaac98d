"""Vertices for triangles without shared ones: one map for all frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ConnectivityError, ShapeError
from modalmotion.formats.frames.frame import ONE_MESH, TRACK
from modalmotion.mesh.checks import FloatArray


@dataclass(frozen=True, eq=False)
class MergeMap:
    """Map from corners of triangles to merged vertices.

    Merging each frame by itself would number its vertices anew and break correspondence
    without any sign, so the map of the first frame serves all.

    Parameters
    ----------
    first : (vertices,) int64
        First corner of each vertex, increasing.
    vertex_of : (corners,) int64
    """

    first: NDArray[np.int64]
    vertex_of: NDArray[np.int64]

    @property
    def faces(self) -> NDArray[np.int64]:
        """Triangles of the merged vertices, (faces, 3) int64."""
        return self.vertex_of.reshape(-1, 3)

    def apply(self, corners: FloatArray, frame: int) -> FloatArray:
        """Merge the corners of a frame.

        Parameters
        ----------
        corners : (corners, 3) float32 or float64
        frame : int

        Returns
        -------
        (vertices, 3) float32 or float64

        Raises
        ------
        ShapeError
            If the frame has another number of triangles.
        ConnectivityError
            If corners that were one vertex in the first frame no longer coincide.
        """
        if len(corners) != len(self.vertex_of):
            raise ShapeError(
                f"Frame {frame} has {len(corners) // 3} triangles, frame 0 has "
                f"{len(self.vertex_of) // 3}.",
                remedy=ONE_MESH,
                frame=frame,
            )
        positions = corners[self.first]
        apart = np.flatnonzero((positions[self.vertex_of] != corners).any(axis=1))
        if apart.size:
            corner = int(apart[0])
            vertex = int(self.vertex_of[corner])
            raise ConnectivityError(
                f"Frame {frame}: the corners that are vertex {vertex} in frame 0 are apart "
                f"(corner {corner % 3} of triangle {corner // 3}; {apart.size} such corners).",
                remedy="STL contains no vertices, so those of frame 0 count for all frames. Send a "
                "format that has them (PLY, OBJ, VTK), or triangles in the same order; or track "
                f"the frames as they are: {TRACK}.",
                frame=frame,
                vertex=vertex,
                details={"corner": corner, "count": int(apart.size)},
            )
        return positions


def merge_corners(corners: FloatArray) -> MergeMap:
    """Merge corners at exactly the same place into one vertex, in order of appearance.

    Parameters
    ----------
    corners : (corners, 3) float32 or float64

    Returns
    -------
    MergeMap
    """
    # Adding zero turns -0 into 0; equal rows then have equal bytes, which sort fast.
    rows = np.ascontiguousarray(corners + corners.dtype.type(0))
    keys = rows.view(np.dtype((np.void, rows.itemsize * 3))).ravel()
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return MergeMap(first[order].astype(np.int64), rank[inverse.ravel()].astype(np.int64))
