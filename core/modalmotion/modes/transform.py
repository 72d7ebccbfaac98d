"""Transforms of displacements on lattices to modal amplitudes and back.

A few modes are products with their shapes. All of them are Fourier transforms on closed axes and
cosine transforms on open ones; towards a pole the cosine transform for even p' and a sine transform
for odd p', of type IV on a cup and of type II on a sphere.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.errors import NonFiniteError, ShapeError
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.mode_set import ModeSet
from modalmotion.modes.topology import CLOSED, OPEN, POLE_OPEN
from modalmotion.representation import Floats, Ints

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
            f"'{name}' contains {frames.dtype}, not real numbers.",
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


def project(lattice: Lattice, modes: ModeSet, displacements: NDArray[Any]) -> Floats:
    """Amplitudes of modes in displacements, (2) inverted: a = Phi'u / nodes.

    Parameters
    ----------
    lattice : Lattice
    modes : ModeSet
    displacements : (frames, nodes, directions) float32 or float64, any length unit
        Read in blocks of frames, so that it may be mapped from a file.

    Returns
    -------
    (frames, modes, directions) float64, the same unit

    Raises
    ------
    ShapeError
        If the displacements are not a real array of that shape.
    NonFiniteError
        Naming the first frame and node that are not finite.
    TopologyError, ParameterError
        If the lattice has no such modes.
    """
    source = require_frames(displacements, "displacements", lattice.n_nodes, "nodes")
    amplitudes = np.empty((len(source), len(modes), source.shape[2]))
    # Overflow shows in the amplitudes.
    with np.errstate(over="ignore", invalid="ignore"):
        for some in blocks(len(modes), lattice.n_nodes):
            shapes = lattice.shapes(modes.take(some)).T
            for frames in blocks(len(source), lattice.n_nodes * source.shape[2]):
                block = np.ascontiguousarray(source[frames], dtype=np.float64)
                result = shapes @ block / lattice.n_nodes
                require_finite(result, block, frames.start, "node")
                amplitudes[frames, some] = result
    return amplitudes


def superpose(lattice: Lattice, modes: ModeSet, amplitudes: NDArray[Any]) -> Floats:
    """Displacements of modes with these amplitudes, modal superposition (2) u = Phi a.

    Parameters
    ----------
    lattice : Lattice
    modes : ModeSet
    amplitudes : (frames, modes, directions) float32 or float64, any length unit

    Returns
    -------
    (frames, nodes, directions) float64, the same unit

    Raises
    ------
    ShapeError
        If the amplitudes are not a real array of that shape.
    NonFiniteError
        Naming the first frame and mode that are not finite.
    TopologyError, ParameterError
        If the lattice has no such modes.
    """
    source = require_frames(amplitudes, "amplitudes", len(modes), "modes")
    require_finite(source, source, 0, "mode")
    displacements = np.zeros((len(source), lattice.n_nodes, source.shape[2]))
    for some in blocks(len(modes), lattice.n_nodes):
        shapes = lattice.shapes(modes.take(some))
        for frame, values in enumerate(source[:, some]):
            displacements[frame] += shapes @ values.astype(np.float64)
    return displacements


def project_all(lattice: Lattice, displacements: NDArray[Any]) -> Floats:
    """Amplitudes of every mode of a lattice, (2) inverted: a = Phi'u / nodes.

    Parameters
    ----------
    lattice : Lattice
    displacements : (frames, nodes, directions) float32 or float64, any length unit
        Read frame by frame, so that it may be mapped from a file.

    Returns
    -------
    (frames, modes, directions) float64, the same unit
        In the order of `Lattice.all_modes`; equal to those of `project`, to rounding.

    Raises
    ------
    ShapeError
        If the displacements are not a real array of that shape.
    NonFiniteError
        Naming the first frame and node that are not finite.
    """
    source = require_frames(displacements, "displacements", lattice.n_nodes, "nodes")
    amplitudes = np.empty(source.shape)
    modes = lattice.all_modes()
    place, weights = _places(lattice, modes), lattice.scales(modes)[:, None] / lattice.n_nodes
    is_sine = modes.is_sine[:, None]
    for frame, values in enumerate(source):
        with np.errstate(over="ignore", invalid="ignore"):
            found = _forward(lattice, values)[place]
            # The transform's imaginary part is minus the sine.
            np.multiply(np.where(is_sine, -found.imag, found.real), weights, out=amplitudes[frame])
        # Else the next frame's transform would need memory beside it.
        del found
        require_finite(amplitudes[frame][None], source[frame : frame + 1], frame, "node")
    return amplitudes


def superpose_all(lattice: Lattice, amplitudes: NDArray[Any]) -> Floats:
    """Displacements of every mode of a lattice with these amplitudes, (2) u = Phi a.

    Parameters
    ----------
    lattice : Lattice
    amplitudes : (frames, modes, directions) float32 or float64, any length unit
        In the order of `Lattice.all_modes`.

    Returns
    -------
    (frames, nodes, directions) float64, the same unit

    Raises
    ------
    ShapeError
        If the amplitudes are not a real array of that shape.
    NonFiniteError
        Naming the first frame and mode that are not finite.
    """
    source = require_frames(amplitudes, "amplitudes", lattice.n_nodes, "modes")
    displacements = np.empty(source.shape)
    modes = lattice.all_modes()
    place, weights = _places(lattice, modes), lattice.scales(modes)
    for axis, (ends, n) in enumerate(zip(lattice.topology.ends, lattice.shape, strict=True)):
        if ends != CLOSED:
            # The transforms back count twice what is neither constant nor alternates.
            weights = weights * np.where(modes.half_periods[:, axis] % (2 * n), 0.5, 1.0)
    cosines, sines = np.flatnonzero(~modes.is_sine), np.flatnonzero(modes.is_sine)
    for frame in range(len(source)):
        values = np.asarray(source[frame], dtype=np.float64)
        require_finite(values[None], values[None], frame, "mode")
        values = values * weights[:, None]
        spectrum = np.zeros(source.shape[1:], dtype=np.complex128)
        spectrum[place[cosines]] = values[cosines]
        spectrum[place[sines]] -= 1j * values[sines]
        displacements[frame] = _backward(lattice, spectrum)
    return displacements


def _places(lattice: Lattice, modes: ModeSet) -> Ints:
    """Place of each mode's wave vector in the spectrum, row by row."""
    p = modes.wavenumbers % np.array(lattice.shape)
    return np.asarray(np.ravel_multi_index(tuple(p.T), lattice.shape))


def _forward(lattice: Lattice, values: NDArray[Any]) -> NDArray[np.complex128]:
    """Sum displacements times cosine and minus i times sine of each wave: (nodes, directions)."""
    closed = lattice.topology.closed_axes
    x: NDArray[Any] = values.astype(np.float64).reshape(*lattice.shape, -1)
    # Node n = N of a closed axis is at the transform's origin, angle 0.
    x = scipy.fft.fftn(np.roll(x, (1,) * len(closed), axis=closed), axes=closed)
    for axis, ends in enumerate(lattice.topology.ends):
        if ends == OPEN:
            x = scipy.fft.dct(x, type=2, axis=axis) / 2
        elif ends != CLOSED:
            even, odd = _by_parity(x, axis + 1)
            even[...] = scipy.fft.dct(even, type=2, axis=axis) / 2
            odd[...] = scipy.fft.dst(odd, type=4 if ends == POLE_OPEN else 2, axis=axis) / 2
    return x.reshape(values.shape).astype(np.complex128, copy=False)


def _backward(lattice: Lattice, spectrum: NDArray[np.complex128]) -> Floats:
    """Sum multiples of waves: (nodes, directions)."""
    closed = lattice.topology.closed_axes
    x = spectrum.reshape(*lattice.shape, -1)
    for axis, ends in enumerate(lattice.topology.ends):
        if ends == OPEN:
            x = scipy.fft.dct(x, type=3, axis=axis)
        elif ends != CLOSED:
            even, odd = _by_parity(x, axis + 1)
            even[...] = scipy.fft.dct(even, type=3, axis=axis)
            odd[...] = scipy.fft.dst(odd, type=4 if ends == POLE_OPEN else 3, axis=axis)
    x = scipy.fft.ifftn(x, axes=closed, norm="forward", overwrite_x=True)
    return np.roll(x.real, (-1,) * len(closed), axis=closed).reshape(spectrum.shape)


def _by_parity(
    x: NDArray[np.complex128], axis: int
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """View the even and the odd wavenumbers along an axis."""
    before = (slice(None),) * axis
    return x[(*before, slice(0, None, 2))], x[(*before, slice(1, None, 2))]
