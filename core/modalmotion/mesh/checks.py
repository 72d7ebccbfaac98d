"""Checks of arrays at public entry points, and the uncertainty of positions."""

import math
from dataclasses import dataclass
from math import isfinite
from typing import Any, Final, TypeVar

import numpy as np

from modalmotion.arguments.checking import FrozenArrays
from modalmotion.errors import NonFiniteError, ParameterError, ShapeError
from modalmotion.notes import Note
from modalmotion.representation import Array, FloatArray, Floats, Ints, Singles, shown

AnyArray = TypeVar("AnyArray", bound=Array)


LARGEST: Final = 1e304
"""Largest coordinate and time, either way: sums of larger ones overflow."""

SMALLEST: Final = 1e-300
"""Largest coordinate, if not 0, is at least this: inverses of smaller ones overflow."""


def kept(array: AnyArray, given: object) -> AnyArray:
    """Give an array that nobody else can change: a copy, unless it is frozen or new.

    Parameters
    ----------
    array : ndarray
        Made from `given`, and new where that had another type or layout.
    given : object
        As the caller has it.
    """
    root: Any = array
    while isinstance(root, np.ndarray) and root.base is not None:
        root = root.base
    is_new = array is not given and array.base is None
    is_array = isinstance(root, np.ndarray)
    is_frozen = isinstance(root, bytes) or (is_array and not root.flags.writeable)
    if not is_new and not (is_frozen and not array.flags.writeable):
        array = array.copy()
    array.setflags(write=False)
    return array


def given_up(array: AnyArray) -> AnyArray:
    """Freeze an array that its maker will not change, so that nothing copies it."""
    array.setflags(write=False)
    return array


def _unmasked(array: Any, name: str) -> Any:
    """Take the data of a masked array in which nothing is masked.

    Raises
    ------
    NonFiniteError
        Naming the first entry that is.
    """
    # First what says so without loading numpy.ma.
    if type(array) is np.ndarray or not isinstance(array, np.ma.MaskedArray):
        return array
    masked = np.argwhere(np.ma.getmaskarray(array))  # type: ignore[no-untyped-call]
    if len(masked):
        place = [int(i) for i in masked[0]]
        where = ", ".join(map("{} {}".format, ("frame", "vertex"), place))
        raise NonFiniteError(
            f"'{name}' is masked at {where}: {len(masked)} of its numbers are missing.",
            remedy="Repair or leave out the frame; missing points are not guessed.",
            frame=place[0],
            vertex=place[1] if len(place) > 1 else None,
        )
    return array.data


def require_vertices(vertices: Any) -> FloatArray:
    """Check an array of positions: (frames, vertices, 3), real, finite.

    Parameters
    ----------
    vertices : array_like

    Returns
    -------
    (frames, vertices, 3) float32 or float64
        C-contiguous and frozen; float32 stays float32, everything else becomes float64.

    Raises
    ------
    ShapeError
        If it is not a real array of that shape with at least one frame and one vertex.
    NonFiniteError
        Naming the first frame and vertex that are not finite, or masked.
    ParameterError
        If the coordinates are too large or too small for sums and inverses to be numbers.
    """
    vertices = _unmasked(vertices, "vertices")
    array = np.asarray(vertices)
    if array.dtype.kind not in "fiu":
        raise ShapeError(
            f"'vertices' contains {array.dtype}, not numbers.",
            remedy="Store float32 or float64 coordinates.",
        )
    if array.ndim != 3 or array.shape[2] != 3:
        raise ShapeError(
            f"'vertices' has the shape {array.shape}, not (frames, vertices, 3).",
            remedy="Stack the frames along the first axis; pad flat contours with z = 0.",
        )
    if array.shape[0] == 0 or array.shape[1] == 0:
        raise ShapeError(
            f"'vertices' has {array.shape[0]} frames of {array.shape[1]} vertices.",
            remedy="Send at least one frame with at least one vertex.",
        )
    dtype = np.float32 if array.dtype == np.float32 else np.float64
    array = np.ascontiguousarray(array, dtype=dtype)
    with np.errstate(invalid="ignore"):
        # Neither is finite where one number is not.
        low, high = float(array.min()), float(array.max())
    for frame, positions in enumerate(() if isfinite(low) and isfinite(high) else array):
        require_finite(positions, frame)
    _require_size(array, low, high)
    return kept(array, vertices)


def require_finite(positions: FloatArray, frame: int) -> None:
    """Refuse positions of a frame, (vertices, 3), that are not finite.

    Raises
    ------
    NonFiniteError
        Naming the first vertex that is not.
    """
    if not np.isfinite(positions).all():
        bad = np.argwhere(~np.isfinite(positions))
        vertex, axis = (int(i) for i in bad[0])
        raise NonFiniteError(
            f"Frame {frame}, vertex {vertex}: {'xyz'[axis]} is {positions[vertex, axis]} "
            f"({len(bad)} such values in this frame).",
            remedy="Repair or leave out the frame; missing points are not guessed.",
            frame=frame,
            vertex=vertex,
        )


def _require_size(array: FloatArray, low: float, high: float) -> None:
    largest = max(-low, high)
    if largest == 0.0 or SMALLEST <= largest <= LARGEST:
        return
    frame, vertex, axis = np.unravel_index(
        int(np.argmax(array) if high == largest else np.argmin(array)), array.shape
    )
    is_large = largest > LARGEST
    raise ParameterError(
        f"Frame {frame}, vertex {vertex}: {'xyz'[int(axis)]} is {array[frame, vertex, axis]:.3g}, "
        + (
            f"beyond {LARGEST:g}, where sums overflow."
            if is_large
            else f"and no coordinate reaches {SMALLEST:g}, below which numbers lose digits."
        ),
        remedy=f"State lengths in a {'larger' if is_large else 'smaller'} unit.",
        frame=int(frame),
        vertex=int(vertex),
    )


def single_precision(values: Array, what: str) -> Singles:
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
        rounded: Singles = np.asarray(values).astype("<f4")
    if not np.isfinite(rounded).all():
        raise ParameterError(
            f"{what} is {float(np.abs(values).max()):.3g}, and single precision ends at 3.4e38.",
            remedy="Write the coordinates in a larger unit, or ask for a format in double "
            "precision (npz).",
        )
    return rounded


def require_faces(faces: Any, n_vertices: int, n_frames: int = 0) -> Ints:
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

    array = np.asarray(_unmasked(faces, "faces"))
    if array.size == 0:
        return np.zeros((0, 3), dtype=np.int64)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "iu":
        raise ShapeError(
            f"'faces' has the shape {array.shape} and contains {array.dtype}, "
            "not (faces, 3) integers.",
            remedy="Send triangles as zero-based vertex indices.",
        )
    bad = np.argwhere((array < 0) | (array >= n_vertices))
    if bad.size:
        face, corner = (int(i) for i in bad[0])
        raise ConnectivityError(
            f"Face {face} names vertex {array[face, corner]}, but there are {n_vertices} "
            f"(0 to {n_vertices - 1}).",
            remedy=_remedy_for(array, n_vertices, n_frames),
            vertex=int(array[face, corner]),
        )
    return kept(np.ascontiguousarray(array, dtype=np.int64), faces)


def _remedy_for(faces: Array, n_vertices: int, n_frames: int) -> str:
    low, high = int(faces.min()), int(faces.max())
    if low == 1 and high == n_vertices:
        return "They seem to count from 1: subtract 1 from every index."
    if low >= 0 and n_vertices < high + 1 == n_frames:
        return (
            "The first two axes of 'vertices' seem to be swapped: give (frames, vertices, 3), "
            "such as vertices.transpose(1, 0, 2)."
        )
    return "Use zero-based indices of vertices that every frame contains."


def require_times(times: Any, n_frames: int) -> Floats:
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
    times = _unmasked(times, "times")
    array = np.asarray(times)
    if array.dtype.kind not in "fiu" or array.shape != (n_frames,):
        raise ShapeError(
            f"'times' has the shape {array.shape} and contains {array.dtype}; "
            f"{n_frames} frames need ({n_frames},) numbers.",
            remedy="Send one time in seconds for each frame, or none at all.",
        )
    array = np.ascontiguousarray(array, dtype=np.float64)
    if not np.isfinite(array).all():
        frame = int(np.flatnonzero(~np.isfinite(array))[0])
        raise NonFiniteError(
            f"The time of frame {frame} is {array[frame]}.",
            remedy="Send finite times in seconds, or none at all.",
            frame=frame,
        )
    far = np.flatnonzero(np.abs(array) > LARGEST)
    if far.size:
        frame = int(far[0])
        raise ParameterError(
            f"Frame {frame} is timed at {array[frame]:.3g} s, beyond {LARGEST:g} s, where "
            "differences overflow.",
            remedy="Count the times from the first frame, in seconds.",
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
    return kept(array, times)


@shown("source", "between_frames")
@dataclass(frozen=True, eq=False)
class Uncertainty(FrozenArrays):
    """Error of each position: e = Phi c + d, smooth in modes of its own, and apart from them.

    Parameters
    ----------
    source : str
        What it comes from: "noise", "points" or "images".
    shapes : (vertices, modes) float64
        Phi; no modes where all errors are apart.
    across, along : (frames, 3 modes, 3 modes) float64, length unit squared
        Covariance of c as far as it moves the surface along its normals, and as far as it moves
        vertices along the surface, or anywhere. Row 3 j + i is mode j in direction i.
    rest : (frames,) float64, length unit
        Standard deviation of each coordinate of d.
    alike : (vertices,) float64
        Vertices, itself included, whose d is the same as that of each: 1 where it is its own.
    between_frames : float
        Correlation of the error in one frame with that in the next.
    volumes : (frames,) float64, length unit cubed, optional
        Standard deviation of the volume in each frame.
    volume_correlation : float
        Of the errors of the largest and of the smallest volume.
    papillary_volume : float, length unit cubed
        Muscle within the surface that does not count as cavity.
    notes : tuple of Note
        Caveats of how the surface was found.
    """

    source: str
    shapes: Floats
    across: Floats
    along: Floats
    rest: Floats
    alike: Floats
    between_frames: float = 0.0
    volumes: Floats | None = None
    volume_correlation: float = 0.0
    papillary_volume: float = 0.0
    notes: tuple[Note, ...] = ()

    @staticmethod
    def of_noise(
        sd: float,
        n_frames: int,
        n_vertices: int,
        independent: float,
        between_frames: float = 0.0,
    ) -> "Uncertainty":
        """Take noise of one standard deviation on all coordinates.

        Parameters
        ----------
        sd : float, length unit
        n_frames, n_vertices : int
        independent : float
            Vertices of independent noise that average like these.
        between_frames : float
            Correlation of a vertex's noise in one frame with that in the next.
        """
        nothing = np.zeros((n_frames, 0, 0))
        return Uncertainty(
            source="noise",
            shapes=np.zeros((n_vertices, 0)),
            across=nothing,
            along=nothing,
            rest=np.full(n_frames, sd),
            alike=np.full(n_vertices, n_vertices / max(independent, 1.0)),
            between_frames=between_frames,
        )


def difference_deviation(one: float, other: float, correlation: float) -> float:
    """Deviation of the difference of two numbers with these deviations and this correlation."""
    return math.sqrt(max(one**2 + other**2 - 2.0 * correlation * one * other, 0.0))
