"""Arrays of frames at the doors of the transforms, and their cutting into blocks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import NonFiniteError, ShapeError

# Numbers in a block of frames, 8 MB in float64.
_BLOCK: Final = 1 << 20


def require_frames(array: Any, name: str, length: int, of: str) -> NDArray[Any]:
    """Check an array of frames: (frames, `length`, directions), real numbers.

    Parameters
    ----------
    array : array_like
        Neither copied nor read: it may be mapped from a file.
    name : str
        Its name in the error.
    length : int
    of : str
        Meaning of `length`.

    Raises
    ------
    ShapeError
        If it is not a real array of that shape.
    """
    frames: NDArray[Any] = np.asanyarray(array)
    if frames.dtype.kind not in "fiu":
        raise ShapeError(
            f"'{name}' holds {frames.dtype}, not real numbers.",
            remedy="Use float32 or float64.",
            details={"array": name, "dtype": str(frames.dtype)},
        )
    if frames.ndim != 3 or frames.shape[1] != length:
        raise ShapeError(
            f"'{name}' has the shape {frames.shape}, not (frames, {length} {of}, directions).",
            remedy="Put frames first and directions last; a single frame needs its axis too.",
            details={"array": name, "shape": list(frames.shape)},
        )
    return frames


def require_output(out: NDArray[Any] | None, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Check or make the array that receives the answer.

    Raises
    ------
    ShapeError
        If it is not a writeable C-contiguous float64 array of that shape.
    """
    if out is None:
        return np.empty(shape)
    if (
        out.shape != shape
        or out.dtype != np.float64
        or not out.flags.writeable
        or not out.flags.c_contiguous
    ):
        raise ShapeError(
            f"'out' cannot receive the answer: {out.dtype} of the shape {out.shape} came, and "
            f"writeable C-contiguous float64 of the shape {shape} is needed.",
            remedy="Give such an array, which may be mapped from a file, or none.",
            details={"array": "out", "shape": list(out.shape)},
        )
    return out


def blocks(n_frames: int, frame_size: int) -> Iterator[slice]:
    """Cut frames into blocks of at most 8 MB in float64, and of at least one frame."""
    n = max(1, _BLOCK // max(1, frame_size))
    for first in range(0, n_frames, n):
        yield slice(first, min(first + n, n_frames))


def require_finite(result: NDArray[Any], source: NDArray[Any], first: int, of: str) -> None:
    """Refuse frames that are not finite, detected in a result to which every number adds.

    Looking at the few results costs nothing beside looking at every number of the source.

    Parameters
    ----------
    result : (frames, ..., directions)
    source : (frames, vertices or modes, directions)
    first : int
        Number of the first frame.
    of : str
        Meaning of the middle axis of `source`.

    Raises
    ------
    NonFiniteError
        Naming the frame and the number at fault.
    """
    if np.isfinite(result).all():
        return
    bad = np.argwhere(~np.isfinite(source))
    if not bad.size:
        frame = int(np.argwhere(~np.isfinite(result))[0, 0])
        raise NonFiniteError(
            f"The numbers of frame {first + frame} are finite, but too large for their sum.",
            remedy="Use a larger unit of length.",
            frame=first + frame,
        )
    frame, number, direction = (int(i) for i in bad[0])
    raise NonFiniteError(
        f"Frame {first + frame}, {of} {number}: direction {direction} is "
        f"{source[frame, number, direction]}.",
        remedy="Repair or leave out the frame; missing numbers are not guessed.",
        frame=first + frame,
        vertex=number if of == "node" else None,
        details={of: number, "direction": direction, "count": len(bad)},
    )
