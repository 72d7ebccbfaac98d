"""Displacements of a lattice as amplitudes of all its modes, and back, by fast transforms.

Real Fourier transforms on closed axes; cosine transforms on open ones; towards a pole the
cosine transform for even p' and a sine transform for odd p', of type IV on a cup and of type
II on a sphere.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.modes.frames import require_finite, require_frames, require_output
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.spectrum_places import Places, spectrum_shape
from modalmotion.modes.topology import CLOSED, OPEN, POLE_OPEN


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
    # Node n = N of a closed axis stands at the transform's origin, angle 0.
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
