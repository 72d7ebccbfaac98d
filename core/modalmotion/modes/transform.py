"""Transforms of displacements on lattices to modal amplitudes and back.

One product for each axis with the few functions that occur along it: N N' P + N' P P'
multiplications instead of N N' for each mode.

Real Fourier transforms on closed axes; cosine transforms on open ones; towards a pole the
cosine transform for even p' and a sine transform for odd p', of type IV on a cup and of type
II on a sphere.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.errors import NonFiniteError, ShapeError
from modalmotion.modes.lattice import Lattice, Places, spectrum_shape
from modalmotion.modes.mode_set import ModeSet
from modalmotion.modes.separable import Factors
from modalmotion.modes.topology import CLOSED, OPEN, POLE_OPEN, Topology
from modalmotion.numeric.products import multiply

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


# Numbers in factors cached from call to call, at most 512 KB: frame after frame their
# evaluation would take as long as the products. Larger ones take little beside theirs.
_KEPT: Final = 1 << 16


def project(lattice: Lattice, modes: ModeSet, displacements: NDArray[Any]) -> NDArray[np.float64]:
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
        The same bits on any number of threads, and for a frame in any company.

    Raises
    ------
    ShapeError
        If the displacements are not a real array of that shape.
    NonFiniteError
        Naming the first frame and node that are not finite.
    TopologyError, ParameterError
        If the lattice has no such modes.
    """
    return project_with(_factors(lattice, modes), displacements)


def superpose(
    lattice: Lattice,
    modes: ModeSet,
    amplitudes: NDArray[Any],
    *,
    out: NDArray[Any] | None = None,
) -> NDArray[np.float64]:
    """Displacements of modes with these amplitudes, modal superposition (2) u = Phi a.

    Parameters
    ----------
    lattice : Lattice
    modes : ModeSet
    amplitudes : (frames, modes, directions) float32 or float64, any length unit
    out : (frames, nodes, directions) float64, optional
        Receives the displacements. Mapped to a file, it bounds the memory.

    Returns
    -------
    (frames, nodes, directions) float64, the same unit
        The same bits on any number of threads, and for a frame in any company.

    Raises
    ------
    ShapeError
        If the amplitudes or `out` are not a real array of that shape.
    NonFiniteError
        Naming the first frame and mode that are not finite.
    TopologyError, ParameterError
        If the lattice has no such modes.
    """
    return superpose_with(_factors(lattice, modes), amplitudes, out=out)


def project_with(factors: Factors, displacements: NDArray[Any]) -> NDArray[np.float64]:
    """Project with factors at hand; see `project`."""
    source = require_frames(displacements, "displacements", factors.n_nodes, "nodes")
    n_directions = source.shape[2]
    n_products = factors.separable.n_products
    first, *others = factors.separable.sums
    weights = factors.coefficients[:, None]
    amplitudes = np.empty((len(source), factors.n_modes, n_directions))
    # Overflow shows in the amplitudes.
    with np.errstate(over="ignore", invalid="ignore"):
        for frames in blocks(len(source), factors.n_nodes * n_directions):
            block = np.ascontiguousarray(source[frames], dtype=np.float64)
            values, n_done = block, len(block)
            for f in factors.functions:
                values = multiply(f, values.reshape(n_done, f.shape[1], -1))
                n_done *= len(f)
            values = values.reshape(len(block), n_products, n_directions)
            result = amplitudes[frames]
            np.multiply(values.take(first.product, axis=1), weights[first.term], out=result)
            for terms in others:
                result[:, terms.mode] += values[:, terms.product] * weights[terms.term]
            result /= factors.n_nodes
            require_finite(result, block, frames.start, "node")
    return amplitudes


def superpose_with(
    factors: Factors, amplitudes: NDArray[Any], *, out: NDArray[Any] | None = None
) -> NDArray[np.float64]:
    """Superpose with factors at hand; see `superpose`."""
    source = require_frames(amplitudes, "amplitudes", factors.n_modes, "modes")
    n_directions = source.shape[2]
    n_products = factors.separable.n_products
    first, *others = factors.separable.spreads
    weights = factors.coefficients[:, None]
    displacements = require_output(out, (len(source), factors.n_nodes, n_directions))
    for frames in blocks(len(source), factors.n_nodes * n_directions):
        block = np.ascontiguousarray(source[frames], dtype=np.float64)
        require_finite(block, block, frames.start, "mode")
        values = np.zeros((len(block), n_products, n_directions))
        values[:, first.product] = block.take(first.mode, axis=1) * weights[first.term]
        for terms in others:
            values[:, terms.product] += block[:, terms.mode] * weights[terms.term]
        n_left = len(block) * n_products
        for axis in reversed(range(len(factors.functions))):
            f = factors.functions[axis]
            n_left //= len(f)
            into = None if axis else displacements[frames].reshape(n_left, f.shape[1], -1)
            values = multiply(f.T, values.reshape(n_left, len(f), -1), into)
    return displacements


def _factors(lattice: Lattice, modes: ModeSet) -> Factors:
    """Evaluate factors, or return those of an earlier call."""
    if len(modes) * sum(lattice.shape) <= _KEPT:
        return _factors_kept(lattice.topology, lattice.shape, modes)
    return lattice.factors(modes)


@lru_cache(maxsize=16)
def _factors_kept(topology: Topology, shape: tuple[int, ...], modes: ModeSet) -> Factors:
    # Shapes do not depend on the springs. The lattice itself is not cached.
    return Lattice(topology, shape).factors(modes)


def project_all(
    lattice: Lattice, displacements: NDArray[Any], *, out: NDArray[Any] | None = None
) -> NDArray[np.float64]:
    """Amplitudes of every mode of a lattice, (2) inverted: a = Phi'u / nodes.

    Parameters
    ----------
    lattice : Lattice
    displacements : (frames, nodes, directions) float32 or float64, any length unit
        Read frame by frame, so that it may be mapped from a file.
    out : (frames, nodes, directions) float64, optional
        Receives the amplitudes. Mapped to a file, it bounds the memory.

    Returns
    -------
    (frames, modes, directions) float64, the same unit
        In the order of `Lattice.all_modes`; equal to those of `project`, to rounding.

    Raises
    ------
    ShapeError
        If the displacements or `out` are not a real array of that shape.
    NonFiniteError
        Naming the first frame and node that are not finite.
    """
    source = require_frames(displacements, "displacements", lattice.n_nodes, "nodes")
    amplitudes = require_output(out, source.shape)
    scales = lattice.scales(lattice.all_modes())
    for frame, values in enumerate(source):
        with np.errstate(over="ignore", invalid="ignore"):
            spectrum = _forward(lattice, values)
            result = amplitudes[frame]
            result[:] = 0.0
            for places in lattice.places:
                part = spectrum[:, :, _part(places)]
                # The transform's imaginary part is minus the sine.
                weight = scales[places.mode] * places.sign * (-1.0) ** sum(places.sines)
                result[places.mode] += part[places.place] * weight[:, None]
            result /= lattice.n_nodes
        require_finite(result[None], source[frame : frame + 1], frame, "node")
    return amplitudes


def superpose_all(
    lattice: Lattice, amplitudes: NDArray[Any], *, out: NDArray[Any] | None = None
) -> NDArray[np.float64]:
    """Displacements of every mode of a lattice with these amplitudes, (2) u = Phi a.

    Parameters
    ----------
    lattice : Lattice
    amplitudes : (frames, modes, directions) float32 or float64, any length unit
        In the order of `Lattice.all_modes`.
    out : (frames, nodes, directions) float64, optional
        Receives the displacements. Mapped to a file, it bounds the memory.

    Returns
    -------
    (frames, nodes, directions) float64, the same unit

    Raises
    ------
    ShapeError
        If the amplitudes or `out` are not a real array of that shape.
    NonFiniteError
        Naming the first frame and mode that are not finite.
    """
    source = require_frames(amplitudes, "amplitudes", lattice.n_nodes, "modes")
    displacements = require_output(out, source.shape)
    scales = lattice.scales(lattice.all_modes())
    for frame in range(len(source)):
        values = np.asarray(source[frame], dtype=np.float64)
        require_finite(values[None], values[None], frame, "mode")
        spectrum = np.zeros(_flat_shape(lattice, source.shape[2]))
        for places in lattice.places:
            part = spectrum[:, :, _part(places)]
            weight = scales[places.mode] * places.sign * (-1.0) ** sum(places.sines)
            weight *= 0.5**places.halvings
            part[places.place] += values[places.mode] * weight[:, None]
        displacements[frame] = _backward(lattice, spectrum)
    return displacements


def _forward(lattice: Lattice, values: NDArray[Any]) -> NDArray[np.float64]:
    """Sum displacements times each product of functions: (places, directions, parts)."""
    topology = lattice.topology
    n_directions = values.shape[1]
    x = values.reshape(*lattice.shape, n_directions)
    # Node n = N of a closed axis is at the transform's origin, angle 0.
    x = np.roll(x, (1,) * len(topology.closed_axes), axis=topology.closed_axes)
    x = x.astype(np.float64, copy=False)
    for axis in topology.closed_axes:
        # Real and imaginary part, the cosine and minus the sine, as a last axis of 2.
        z = np.ascontiguousarray(scipy.fft.rfft(x, axis=axis))
        x = z.view(np.float64).reshape(*z.shape, 2)
    for axis, ends in enumerate(topology.ends):
        if ends == OPEN:
            x = scipy.fft.dct(x, type=2, axis=axis, overwrite_x=True)
        elif ends != CLOSED:
            even, odd = _by_parity(x, axis + 1)
            even[...] = scipy.fft.dct(even, type=2, axis=axis)
            odd[...] = scipy.fft.dst(odd, type=4 if ends == POLE_OPEN else 2, axis=axis)
    # scipy's cosine and sine transforms are twice the sums.
    x *= 0.5 ** (topology.n_axes - len(topology.closed_axes))
    return x.reshape(-1, n_directions, 2 ** len(topology.closed_axes))


def _backward(lattice: Lattice, spectrum: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum multiples of products of functions: (nodes, directions).

    The entry at a place is half the multiple for each axis of mean square 1/2.
    """
    topology = lattice.topology
    x = spectrum.reshape(*_spectrum_shape(lattice, spectrum.shape[1]))
    for axis, ends in enumerate(topology.ends):
        if ends == OPEN:
            x = scipy.fft.dct(x, type=3, axis=axis, overwrite_x=True)
        elif ends != CLOSED:
            even, odd = _by_parity(x, axis + 1)
            even[...] = scipy.fft.dct(even, type=3, axis=axis)
            odd[...] = scipy.fft.dst(odd, type=4 if ends == POLE_OPEN else 3, axis=axis)
    for axis in reversed(topology.closed_axes):
        z = np.ascontiguousarray(x).view(np.complex128)[..., 0]
        x = scipy.fft.irfft(z, n=lattice.shape[axis], axis=axis, norm="forward")
    x = np.roll(x, (-1,) * len(topology.closed_axes), axis=topology.closed_axes)
    return x.reshape(lattice.n_nodes, -1)


def _by_parity(
    x: NDArray[np.float64], axis: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """View the even and the odd wavenumbers along an axis."""
    before = (slice(None),) * axis
    return x[(*before, slice(0, None, 2))], x[(*before, slice(1, None, 2))]


def _flat_shape(lattice: Lattice, n_directions: int) -> tuple[int, int, int]:
    n_places = math.prod(spectrum_shape(lattice.topology, lattice.shape))
    return n_places, n_directions, 2 ** len(lattice.topology.closed_axes)


def _spectrum_shape(lattice: Lattice, n_directions: int) -> tuple[int, ...]:
    wavenumbers = spectrum_shape(lattice.topology, lattice.shape)
    return (*wavenumbers, n_directions, *(2 for _ in lattice.topology.closed_axes))


def _part(places: Places) -> int:
    """Find the number of a product among all products of cosines and sines of the closed axes."""
    return sum(2**i for i, sine in enumerate(reversed(places.sines)) if sine)


__all__ = ["project", "project_all", "project_with", "superpose", "superpose_all", "superpose_with"]
