"""Checks of arrays at the public doors; inner functions trust checked arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import NonFiniteError, ParameterError, ShapeError

FloatArray = NDArray[np.float32] | NDArray[np.float64]


def require_vertices(vertices: Any, name: str = "vertices") -> FloatArray:
    """Check an array of positions: (frames, vertices, 3), real, finite.

    Parameters
    ----------
    vertices : array_like
    name : str
        Its name in the error.

    Returns
    -------
    (frames, vertices, 3) float32 or float64
        C-contiguous; float32 stays float32, everything else becomes float64.

    Raises
    ------
    ShapeError
        If it is not a real array of that shape with at least one frame and one vertex.
    NonFiniteError
        Naming the first frame and vertex that are not finite.
    """
    array = np.asarray(vertices)
    if array.dtype.kind not in "fiu":
        raise ShapeError(
            f"'{name}' holds {array.dtype}, not numbers.",
            remedy="Store float32 or float64 coordinates.",
            details={"array": name, "dtype": str(array.dtype)},
        )
    if array.ndim != 3 or array.shape[2] != 3:
        raise ShapeError(
            f"'{name}' has the shape {array.shape}, not (frames, vertices, 3).",
            remedy="Stack the frames along the first axis; pad flat contours with z = 0.",
            details={"array": name, "shape": list(array.shape)},
        )
    if array.shape[0] == 0 or array.shape[1] == 0:
        raise ShapeError(
            f"'{name}' has {array.shape[0]} frames of {array.shape[1]} vertices.",
            remedy="Send at least one frame with at least one vertex.",
            details={"array": name, "shape": list(array.shape)},
        )
    dtype = np.float32 if array.dtype == np.float32 else np.float64
    array = np.ascontiguousarray(array, dtype=dtype)
    for frame, positions in enumerate(array):
        if not np.isfinite(positions).all():
            bad = np.argwhere(~np.isfinite(positions))
            vertex, axis = (int(i) for i in bad[0])
            raise NonFiniteError(
                f"Frame {frame}, vertex {vertex}: {'xyz'[axis]} is "
                f"{positions[vertex, axis]} ({len(bad)} such values in this frame).",
                remedy="Repair or leave out the frame; missing points are not guessed.",
                frame=frame,
                vertex=vertex,
                details={"array": name, "count": len(bad)},
            )
    return array


def single_precision(values: NDArray[Any], what: str) -> NDArray[np.float32]:
    """Round to little-endian float32, for formats without double precision.

    Parameters
    ----------
    values : array of float32 or float64
    what : str
        Their name in the error, such as "A position".

    Raises
    ------
    ParameterError
        If one of them is beyond the range of float32.
    """
    with np.errstate(over="ignore"):
        rounded: NDArray[np.float32] = np.asarray(values).astype("<f4")
    if not np.isfinite(rounded).all():
        raise ParameterError(
            f"{what} is {float(np.abs(values).max()):.3g}, and single precision ends at 3.4e38.",
            remedy="Write the coordinates in a larger unit, or ask for a format in double "
            "precision (npz).",
        )
    return rounded


def require_faces(faces: Any, n_vertices: int, n_frames: int = 0) -> NDArray[np.int64]:
    """Check triangles: (faces, 3) integers that name existing vertices.

    Parameters
    ----------
    faces : array_like
    n_vertices : int
    n_frames : int, optional
        Where the frames are known: faces that would fit their number say that axes were swapped.

    Returns
    -------
    (faces, 3) int64

    Raises
    ------
    ShapeError
        If it is not an integer array of that shape.
    ConnectivityError
        Naming the first face out of range.
    """
    from modalmotion.errors import ConnectivityError

    array = np.asarray(faces)
    if array.size == 0:
        return np.zeros((0, 3), dtype=np.int64)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "iu":
        raise ShapeError(
            f"'faces' has the shape {array.shape} and holds {array.dtype}, "
            "not (faces, 3) integers.",
            remedy="Send triangles as zero-based vertex indices.",
            details={"array": "faces", "shape": list(array.shape)},
        )
    bad = np.argwhere((array < 0) | (array >= n_vertices))
    if bad.size:
        face, corner = (int(i) for i in bad[0])
        raise ConnectivityError(
            f"Face {face} names vertex {array[face, corner]}, but there are {n_vertices} "
            f"(0 to {n_vertices - 1}).",
            remedy=_remedy_for(array, n_vertices, n_frames),
            vertex=int(array[face, corner]),
            details={"face": face, "n_vertices": n_vertices, "count": len(bad)},
        )
    return np.ascontiguousarray(array, dtype=np.int64)


def _remedy_for(faces: NDArray[Any], n_vertices: int, n_frames: int) -> str:
    low, high = int(faces.min()), int(faces.max())
    if low == 1 and high == n_vertices:
        return "They seem to count from 1: subtract 1 from every index."
    if low >= 0 and n_vertices < high + 1 == n_frames:
        return (
            "The first two axes of 'vertices' seem to be swapped: give (frames, vertices, 3), "
            "such as vertices.transpose(1, 0, 2)."
        )
    return "Use zero-based indices of vertices that every frame holds."


def require_times(times: Any, n_frames: int) -> NDArray[np.float64]:
    """Check time stamps: (frames,) finite, strictly increasing.

    Returns
    -------
    (frames,) float64, s

    Raises
    ------
    ShapeError
        If there is not one for each frame, or they do not increase.
    NonFiniteError
        Naming the first frame whose time is not finite.
    """
    array = np.asarray(times)
    if array.dtype.kind not in "fiu" or array.shape != (n_frames,):
        raise ShapeError(
            f"'times' has the shape {array.shape} and holds {array.dtype}; "
            f"{n_frames} frames need ({n_frames},) numbers.",
            remedy="Send one time in seconds for each frame, or none at all.",
            details={"array": "times", "shape": list(array.shape)},
        )
    array = np.ascontiguousarray(array, dtype=np.float64)
    if not np.isfinite(array).all():
        frame = int(np.flatnonzero(~np.isfinite(array))[0])
        raise NonFiniteError(
            f"The time of frame {frame} is {array[frame]}.",
            remedy="Send finite times in seconds, or none at all.",
            frame=frame,
        )
    late = np.flatnonzero(np.diff(array) <= 0)
    if late.size:
        frame = int(late[0]) + 1
        raise ShapeError(
            f"Frame {frame} is timed at {array[frame]} s, not after frame {frame - 1} at "
            f"{array[frame - 1]} s.",
            remedy="Sort the frames by time and drop duplicates.",
            frame=frame,
        )
    return array
