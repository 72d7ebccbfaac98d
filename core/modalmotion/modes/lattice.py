"""Lattices of masses and springs: their modes, in closed form, and displacements in them.

Equation numbers are those of Nastar, INRIA research report, 1994.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Final

import numpy as np
import scipy

from modalmotion import errors
from modalmotion.arguments.checking import real, whole_numbers
from modalmotion.modes import topologies
from modalmotion.modes.mode_set import ModeSet, all_modes, lowest_modes, whole_count
from modalmotion.representation import Array, Bools, Complexes, Floats, Ints, shown


@shown()
@dataclass(frozen=True)
class Lattice:
    """A lattice of equal masses joined by springs to their neighbours along each axis.

    Nodes are numbered row by row: node = row * N' + column. Their displacements U move by
    (1) M U'' + C U' + K U = F, one direction at a time: M is the mass of a node, K the stiffness
    matrix of the springs. Its modes (6) K Phi = M Phi Omega^2 are `shapes`, Phi, and
    `angular_frequencies`, the diagonal of Omega, both in closed form: neither K nor any other
    matrix of the size of the lattice is ever built.

    Parameters
    ----------
    topology : Topology
    shape : tuple of int
        Nodes along each axis.
    stiffness : float or tuple of float, force per length
        K, one for all axes or one for each.
    mass : float
        M of one node.

    Raises
    ------
    ShapeError
        If the shape does not fit the topology.
    ParameterError
        If a stiffness or the mass is not positive and finite.
    """

    topology: topologies.Topology
    shape: tuple[int, ...]
    stiffness: float | tuple[float, ...] = 1.0
    mass: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", whole_numbers("shape", self.shape))
        topologies.require_shape(self.topology, self.shape)
        for K in self.stiffnesses:
            real("stiffness, one number or a tuple of one for each axis,", K)
        real("mass", self.mass)
        for name, value in (("stiffness K", self.stiffnesses), ("mass M", (self.mass,))):
            if not all(math.isfinite(v) and v > 0 for v in value):
                raise errors.ParameterError(
                    f"The {name} is {value}, but only positive finite values make a lattice "
                    "that oscillates.",
                    remedy="Use values above zero.",
                )
        if len(self.stiffnesses) != self.topology.n_axes:
            raise errors.ParameterError(
                f"{len(self.stiffnesses)} stiffnesses for {self.topology.n_axes} axes.",
                remedy="Give one stiffness, or one for each axis.",
            )
        # No mode is faster than all springs stretched together.
        ratios, exponent = self.squared_speeds
        with np.errstate(over="ignore"):
            fastest = np.ldexp(np.sqrt(4.0 * ratios.sum()), exponent // 2)
        if not np.isfinite(fastest):
            raise errors.ParameterError(
                f"Stiffnesses {self.stiffnesses} with the mass {self.mass} make frequencies beyond "
                "the largest number.",
                remedy="State them in another unit of time, which changes the stiffness alone.",
            )

    @property
    def stiffnesses(self) -> tuple[float, ...]:
        """K along each axis."""
        if isinstance(self.stiffness, tuple):
            return self.stiffness
        return (self.stiffness,) * self.topology.n_axes

    @cached_property
    def squared_speeds(self) -> tuple[Floats, int]:
        """K / M of each axis times 2^-exponent, and the exponent, which is even.

        Neither overflows where the frequencies, their roots, do not; powers of two are exact.
        """
        K, of_K = np.frexp(np.array(self.stiffnesses, dtype=np.float64))
        M, of_M = np.frexp(float(self.mass))
        exponent = 2 * (int(of_K.max() - of_M) // 2)
        return np.ldexp(K / M, of_K - of_M - exponent), exponent

    @property
    def n_nodes(self) -> int:
        """Number of nodes, which is the number of modes."""
        return math.prod(self.shape)

    def lowest_modes(self, n_modes: int) -> ModeSet:
        """First modes in the fixed order, taken literally."""
        return lowest_modes(self.topology, n_modes, self.shape)

    def whole_modes(self, n_modes: int) -> ModeSet:
        """First modes in the fixed order, rounded up so that no pair is split."""
        return self.lowest_modes(whole_count(self.topology, n_modes, self.shape))

    def all_modes(self) -> ModeSet:
        """Every mode, in the fixed order."""
        return self._all_modes

    @cached_property
    def _all_modes(self) -> ModeSet:
        return all_modes(self.topology, self.shape)

    def angular_frequencies(self, modes: ModeSet) -> Floats:
        """Angular frequency of each mode, the dispersion relation (7) summed over the axes.

        Returns
        -------
        (modes,) float64, rad per time unit

        Raises
        ------
        TopologyError, ParameterError
            As `shapes`.
        """
        self._require(modes)
        omega_squared = np.zeros(len(modes))
        ratios, exponent = self.squared_speeds
        for axis, (ends, n, ratio) in enumerate(
            zip(self.topology.ends, self.shape, ratios.tolist(), strict=True)
        ):
            # (7) w^2 = (4 K / M) sin^2(k a / 2), and k a / 2 = p pi / N closed, h pi / 4N else.
            # Never 2 - 2 cos(k a): at N = 1e8 that is wrong by a tenth.
            h = modes.half_periods[:, axis]
            half_angle = sin_pi(h, n if ends == topologies.CLOSED else 4 * n)
            omega_squared += (4.0 * ratio) * half_angle**2
        return np.asarray(np.ldexp(np.sqrt(omega_squared), exponent // 2))

    def shapes(self, modes: ModeSet, nodes: Ints | list[int] | None = None) -> Floats:
        """Evaluate mode shapes at the nodes, the Phi of (6) K Phi = M Phi Omega^2.

        Parameters
        ----------
        modes : ModeSet
        nodes : (nodes,) int64, optional
            These nodes only, in this order. Nothing is built for the others: the lattice may
            be of any size.

        Returns
        -------
        (nodes, modes) float64
            Phi, each column with mean square 1: Phi'Phi is the number of nodes times the
            identity. One mode after the other in memory.

        Raises
        ------
        TopologyError
            If the modes are of another topology.
        ParameterError
            If a mode is beyond the lattice's Nyquist wavenumber.
        ShapeError
            If the lattice has no such node.
        """
        self._require(modes)
        places = map(np.arange, self.shape) if nodes is None else places_along(self.shape, nodes)
        closed, none = self.topology.closed_axes, np.zeros(len(modes), dtype=np.bool_)
        # Each axis has a dimension of its own; listed nodes share one.
        n_dimensions = self.topology.n_axes if nodes is None else 1
        by_mode = self.scales(modes).reshape(-1, *[1] * n_dimensions)
        waves = np.ones(1, dtype=np.complex128)
        for axis, (n, place) in enumerate(zip(self.shape, places, strict=True)):
            h, size = modes.half_periods[:, axis], [len(modes), *[1] * n_dimensions]
            size[1 + axis % n_dimensions] = len(place)
            if axis not in closed:
                # cos or sin(h pi (2n - 1) / 4N), n = 1..N
                factor = cosines(h, 2 * place + 1, 8 * n, modes.is_odd_at_pole[:, axis])
            elif len(closed) == 1:
                # cos or sin(2 pi p n / N)
                factor = cosines(h, place + 1, n, modes.is_sine)
            else:
                # cos(a + b) + i sin(a + b) = (cos a + i sin a) (cos b + i sin b)
                real, imaginary = (cosines(h, place + 1, n, is_sine) for is_sine in (none, ~none))
                waves = waves * (real + 1j * imaginary).reshape(size)
                continue
            by_mode = by_mode * factor.reshape(size)
        if len(closed) > 1:
            is_sine = modes.is_sine.reshape(-1, *[1] * n_dimensions)
            by_mode = by_mode * np.where(is_sine, waves.imag, waves.real)
        return by_mode.reshape(len(modes), -1).T

    def scales(self, modes: ModeSet) -> Floats:
        """Factors that give every shape mean square 1 over the nodes, (modes,) float64.

        As on a continuum, but for shapes that alternate from node to node: these are +1 and
        -1, with mean square 1 already.
        """
        n_waves = modes.n_waves
        closed = list(self.topology.closed_axes)
        if closed:
            k = modes.wavenumbers[:, closed]
            n = np.array([self.shape[axis] for axis in closed])
            n_waves = n_waves - ((2 * k % n == 0).all(axis=1) & (k != 0).any(axis=1))
        for axis, (ends, nodes) in enumerate(zip(self.topology.ends, self.shape, strict=True)):
            if ends != topologies.CLOSED:
                n_waves = n_waves - (modes.half_periods[:, axis] == 2 * nodes)
        return topologies.scales_of(n_waves)

    def _require(self, modes: ModeSet) -> None:
        if modes.topology is not self.topology and modes.topology != self.topology:
            raise errors.TopologyError(
                f"Modes of a {modes.topology} have no place on a {self.topology} lattice.",
                remedy="Choose the modes from the lattice itself, with `lowest_modes`.",
            )
        require_within_zone(modes, self.shape)


def places_along(shape: tuple[int, ...], nodes: Ints | list[int]) -> list[Ints]:
    """Find the place of nodes along each axis.

    Parameters
    ----------
    shape : tuple of int
    nodes : (nodes,) int64
        Numbered row by row.

    Returns
    -------
    list of (nodes,) int64

    Raises
    ------
    ShapeError
        If they are not a list of integers, or one of them is not a node.
    LimitError
        If 64 bits do not number all nodes.
    """
    n_nodes = math.prod(shape)
    if n_nodes >= 2**63:
        raise errors.LimitError(
            f"A lattice of {shape} nodes has more than 64 bits number.",
            remedy="Evaluate the axes one by one, as curves.",
            limit="nodes",
        )
    numbers = np.asarray(nodes)
    if numbers.ndim != 1 or (numbers.size and numbers.dtype.kind not in "iu"):
        raise errors.ShapeError(
            f"Nodes are a list of integers, not {numbers.dtype} of the shape {numbers.shape}.",
            remedy="Number them row by row: node = row * N' + column.",
        )
    bad = np.flatnonzero((numbers < 0) | (numbers >= n_nodes))
    if bad.size:
        raise errors.ShapeError(
            f"There is no node {numbers[bad[0]]} on a lattice of {n_nodes}.",
            remedy=f"Number nodes from 0 to {n_nodes - 1}.",
            vertex=int(numbers[bad[0]]),
        )
    along = np.unravel_index(numbers.astype(np.int64), shape)
    return [place.astype(np.int64) for place in along]


def require_within_zone(modes: ModeSet, shape: tuple[int, ...]) -> None:
    """Refuse modes beyond the lattice's Nyquist wavenumber: they would alias into low ones.

    Raises
    ------
    ParameterError
        Naming the first label at fault and the largest wavenumber the axis resolves, or the
        sine of a wave vector that is its own opposite.
    """
    for axis, (ends, n) in enumerate(zip(modes.topology.ends, shape, strict=True)):
        least, most = (-((n - 1) // 2), n // 2) if ends == topologies.CLOSED else (0, n - 1)
        p = modes.wavenumbers[:, axis]
        beyond = np.flatnonzero((p < least) | (p > most))
        if beyond.size:
            raise errors.ParameterError(
                f"Mode {modes.labels[beyond[0]]} is beyond what {n} nodes along axis {axis} "
                f"resolve ({least} to {most}) and would alias into a lower mode.",
                remedy="Ask for lower wavenumbers, or use more nodes.",
                details={"axis": axis, "least": least, "most": most},
            )
    closed = list(modes.topology.closed_axes)
    nodes = np.array([shape[axis] for axis in closed], dtype=np.int64)
    zero = np.flatnonzero(
        modes.is_sine & (2 * modes.wavenumbers[:, closed] % nodes == 0).all(axis=1)
    )
    if zero.size:
        raise errors.ParameterError(
            f"Mode {modes.labels[zero[0]]} is zero at every node of a lattice of {shape} nodes.",
            remedy="Ask for its cosine alone.",
        )


def modes_named(
    topology: topologies.Topology,
    labels: list[topologies.ModeLabel],
    shape: tuple[int, ...] | None = None,
) -> ModeSet:
    """Modes with these labels, each checked to be a mode of the topology.

    Parameters
    ----------
    topology : Topology
    labels : list of ModeLabel
    shape : tuple of int, optional
        Nodes along each axis of a lattice, which has no modes beyond its Nyquist wavenumber.

    Raises
    ------
    ParameterError
        Naming the first label that no mode of the topology has, and the intended one if
        there is one.
    """
    for label in labels:
        topologies.require_mode(topology, label)
    modes = ModeSet.of(topology, labels)
    if shape is not None:
        topologies.require_shape(topology, shape)
        require_within_zone(modes, shape)
    return modes


# Numbers in a block of frames, 8 MB in float64.
_BLOCK: Final = 1 << 20


def require_frames(array: Any, name: str, length: int, of: str) -> Array:
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
    frames: Array = np.asanyarray(array)
    if frames.dtype.kind not in "fiu":
        raise errors.ShapeError(
            f"'{name}' contains {frames.dtype}, not real numbers.",
            remedy="Use float32 or float64.",
            details={"array": name, "dtype": str(frames.dtype)},
        )
    if frames.ndim != 3 or frames.shape[1] != length:
        raise errors.ShapeError(
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


def require_finite(result: Array, source: Array, first: int, of: str) -> None:
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
        raise errors.NonFiniteError(
            f"The numbers of frame {first + frame} are finite, but too large for their sum.",
            remedy="Use a larger unit of length.",
            frame=first + frame,
        )
    frame, number, direction = (int(i) for i in bad[0])
    raise errors.NonFiniteError(
        f"Frame {first + frame}, {of} {number}: direction {direction} is "
        f"{source[frame, number, direction]}.",
        remedy="Repair or leave out the frame; missing numbers are not guessed.",
        frame=first + frame,
        vertex=number if of == "node" else None,
        details={of: number, "direction": direction, "count": len(bad)},
    )


def project(lattice: Lattice, modes: ModeSet, displacements: Array) -> Floats:
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


def superpose(lattice: Lattice, modes: ModeSet, amplitudes: Array) -> Floats:
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


def project_all(lattice: Lattice, displacements: Array) -> Floats:
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
    n_along = lattice.topology.n_axes - len(lattice.topology.closed_axes)
    # The transform along an axis with ends is twice the sum.
    weights = lattice.scales(modes)[:, None] / (2**n_along * lattice.n_nodes)
    place = _places(lattice, modes)
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


def superpose_all(lattice: Lattice, amplitudes: Array) -> Floats:
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
        if ends != topologies.CLOSED:
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


def _forward(lattice: Lattice, values: Array) -> Complexes:
    """Sum displacements times cosine and minus i times sine of each wave: (nodes, directions)."""
    closed = lattice.topology.closed_axes
    x: Array = values.astype(np.float64).reshape(*lattice.shape, -1)
    # Node n = N of a closed axis is at the transform's origin, angle 0.
    x = scipy.fft.fftn(np.roll(x, (1,) * len(closed), axis=closed), axes=closed)
    x = _along_ends(lattice.topology, x, 2)
    return x.reshape(values.shape).astype(np.complex128, copy=False)


def _backward(lattice: Lattice, spectrum: Complexes) -> Floats:
    """Sum multiples of waves: (nodes, directions)."""
    closed = lattice.topology.closed_axes
    x = _along_ends(lattice.topology, spectrum.reshape(*lattice.shape, -1), 3)
    x = scipy.fft.ifftn(x, axes=closed, norm="forward", overwrite_x=True)
    return np.roll(x.real, (-1,) * len(closed), axis=closed).reshape(spectrum.shape)


def _along_ends(topology: topologies.Topology, x: Array, kind: int) -> Array:
    """Transform along the axes with ends, there (2) or back (3); at poles odd waves by sines."""
    for axis, ends in enumerate(topology.ends):
        if ends == topologies.OPEN:
            x = scipy.fft.dct(x, type=kind, axis=axis)
        elif ends != topologies.CLOSED:
            even, odd = (x[(slice(None),) * (axis + 1) + (slice(k, None, 2),)] for k in (0, 1))
            even[...] = scipy.fft.dct(even, type=kind, axis=axis)
            of_odd = 4 if ends == topologies.POLE_OPEN else kind
            odd[...] = scipy.fft.dst(odd, type=of_odd, axis=axis)
    return x


def cos_pi(numerator: Ints, denominator: int) -> Floats:
    """cos(pi numerator / denominator).

    Parameters
    ----------
    numerator : (...) int64
    denominator : int
        Positive and below 2^60.

    Returns
    -------
    (...) float64
    """
    # cos is even with period 2, antisymmetric about 1/2: fold to [0, 1/2].
    k = numerator % (2 * denominator)
    k = np.minimum(k, 2 * denominator - k)
    above = 2 * k > denominator
    k = np.where(above, denominator - k, k)
    # The nearer of 0 and 1/2 is the origin, so that no argument exceeds pi / 4.
    from_half = denominator - 2 * k
    value = np.where(
        4 * k <= denominator,
        np.cos(np.pi * (k / denominator)),
        np.sin((np.pi / 2) * (from_half / denominator)),
    )
    return np.where(above, -value, value)


def sin_pi(numerator: Ints, denominator: int) -> Floats:
    """sin(pi numerator / denominator), to full relative precision near every zero.

    Parameters
    ----------
    numerator : (...) int64
    denominator : int
        Positive and below 2^60.

    Returns
    -------
    (...) float64
    """
    k = numerator % (2 * denominator)
    below = k > denominator
    k = np.where(below, 2 * denominator - k, k)
    k = np.minimum(k, denominator - k)
    from_half = denominator - 2 * k
    # At pi / 4 the cosine, as in `cos_pi`: the same angle has the same bits.
    value = np.where(
        4 * k < denominator,
        np.sin(np.pi * (k / denominator)),
        np.cos((np.pi / 2) * (from_half / denominator)),
    )
    return np.where(below, -value, value)


# Beyond this many parts of a turn single cosines cost less memory than all of a circle.
_LARGEST_CIRCLE: Final = 1 << 16


def cosines(factors: Ints, places: Ints, turn: int, is_sine: Bools) -> Floats:
    """cos, or sin, of 2 pi factor place / turn: whole numbers are reduced before the cosine.

    Parameters
    ----------
    factors : (m,) int64
    places : (n,) int64
    turn : int
    is_sine : (m,) bool
        For each factor.

    Returns
    -------
    (m, n) float64
    """
    parts = 4 * turn // math.gcd(turn, 4)
    # The sine is a quarter turn back.
    phase = exact_products(factors, places, turn) * (parts // turn)
    phase -= is_sine[:, None] * (parts // 4)
    if parts <= _LARGEST_CIRCLE:
        return _circle(parts).take(phase, mode="wrap")
    return cos_pi(phase, parts // 2)


@lru_cache(maxsize=16)
def _circle(parts: int) -> Floats:
    """Cosines of 0, 1, 2 ... of so many equal parts of a turn, for all nodes to look up."""
    return cos_pi(np.arange(parts), parts // 2)


def exact_products(factors: Ints, others: Ints, modulus: int) -> Ints:
    """Outer products reduced modulo `modulus`, in exact integers of any length.

    Parameters
    ----------
    factors, others : (m,), (n,) int64
    modulus : int

    Returns
    -------
    (m, n) int64
        From 0 to `modulus` - 1.
    """
    most = _largest(factors) * _largest(others)
    if most < 2**62:
        return np.asarray(np.multiply.outer(factors, others) % modulus)
    exact = np.multiply.outer(factors.astype(object), others.astype(object)) % modulus
    return np.asarray(exact, dtype=np.int64)


def _largest(integers: Ints) -> int:
    return max(abs(int(integers.min(initial=0))), abs(int(integers.max(initial=0))))
