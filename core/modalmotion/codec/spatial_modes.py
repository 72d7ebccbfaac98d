"""Modes in space, of lattices and of the patches of meshes, and their section of a stream.

They depend on the connectivity alone. Frequencies that coincide (symmetric or repeated parts)
would leave their modes undetermined, so every spring is stiffened a little, by an amount that
its two ends decide: then no two frequencies coincide, and each mode is one vector whose sign
is fixed by a rule. How far rounding can turn the modes is seen by solving again with errors;
encoder and decoder compare a probe of the basis.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from math import prod
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.coder import damaged, parsing, read_varint, read_varints, write_varint
from modalmotion.codec.joined_modes import (
    Each,
    PatchBasis,
    Shaken,
    Springs,
    by_rank,
    edges_of,
    patches_of,
    scatter,
    solve_patch,
    stiffness_of,
)
from modalmotion.codec.temporal import (
    cosines,
    from_cosines,
    from_sines,
    odd_sines,
    sines,
    turn,
    turn_back,
)
from modalmotion.errors import LimitError, MalformedFileError
from modalmotion.modes.order import require_shape
from modalmotion.modes.topology import CLOSED, OPEN, POLE_OPEN, POLE_POLE, Topology

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SPRINGS: Final = 2
"""First byte of the section of these modes."""

LARGEST_PATCH: Final = 4096
# Numbers in proportion to the time to decode, for each vertex: of the leaves, and of joining.
MOST_WORK: Final = 2.0e11
PROBES: Final = 8
PROBE_STEP: Final = 1.0 / 4096.0
SHARES: Final = 256
ROUNDING: Final = 2.0e-15
"""Errors to reckon with: of each entry of a matrix, over its largest."""


@dataclass(frozen=True)
class Cut:
    """How a mesh is cut.

    Parameters
    ----------
    patch : int
        Vertices of the largest patch; a larger component is halved until it fits.
    leaf : int
        Vertices of the largest leaf of a patch; that of the patch where leaves are not joined.
    share : int
        How many modes of the leaves are joined, in 1/256 of the vertices of the patch.
    """

    patch: int
    leaf: int
    share: int = 0

    def n_joined(self, n: int, n_leaves: int) -> int:
        """Modes of the leaves of a patch of n vertices that are joined."""
        return max(n_leaves, min(n, n * self.share // SHARES))

    def work(self, n_vertices: int) -> float:
        """Time to solve, in no unit."""
        patch, leaf = min(self.patch, n_vertices), min(self.leaf, n_vertices)
        joined = 0 if leaf >= patch else self.n_joined(patch, -(-2 * patch // leaf))
        return (float(leaf) ** 2 + float(joined) ** 3 / patch) * n_vertices


@dataclass(frozen=True, eq=False)
class PatchModes:
    """Spring modes of patches of a mesh, smoothest first.

    Parameters
    ----------
    edges : (edges, 2) int64
        Pairs of vertices joined by a spring, each once, smaller first, sorted.
    n_vertices : int
    cut : Cut
    errors : Shaken, optional
        Errors to add to each eigenproblem.
    n_threads : int, optional
        How many patches, or leaves of a lone patch, are solved side by side.
    """

    edges: Ints
    n_vertices: int
    cut: Cut
    errors: Shaken | None = None
    n_threads: int = 1

    @cached_property
    def patches(self) -> list[Ints]:
        """Vertices of each patch, ascending."""
        return patches_of(self.edges, self.n_vertices, self.cut.patch)

    @cached_property
    def _places(self) -> tuple[Ints, Ints]:
        """Patch of each vertex, and its place in it."""
        owner, where = np.empty((2, self.n_vertices), dtype=np.int64)
        for number, patch in enumerate(self.patches):
            owner[patch] = number
            where[patch] = np.arange(len(patch))
        return owner, where

    @cached_property
    def _solved(self) -> dict[int, PatchBasis]:
        """Modes of the patches that were asked for."""
        return {}

    def bases(self, numbers: Sequence[int]) -> list[PatchBasis]:
        """Modes of some patches, for unit stiffness and mass; solved for once."""
        left = [number for number in numbers if number not in self._solved]
        if left:
            self._solved.update(zip(left, self._solve(left), strict=True))
        return [self._solved[number] for number in numbers]

    def _solve(self, numbers: Sequence[int]) -> list[PatchBasis]:
        owner, where = self._places
        inside = owner[self.edges[:, 0]] == owner[self.edges[:, 1]]
        edges = self.edges[inside]
        order = np.argsort(owner[edges[:, 0]], kind="stable")
        edges = edges[order]
        cuts = np.searchsorted(owner[edges[:, 0]], np.arange(len(self.patches) + 1)).tolist()
        stiffness = stiffness_of(edges)
        leaves: list[list[Ints]] = [[] for _ in self.patches]
        parts = self.patches
        if self.cut.leaf < self.cut.patch:
            parts = patches_of(edges, self.n_vertices, self.cut.leaf)
        for part in parts:
            leaves[int(owner[part[0]])].append(where[part])
        several = sum(len(leaves[number]) > 1 for number in numbers) > 1

        def solved(number: int, each: Each = map) -> PatchBasis:
            patch = self.patches[number]
            some = slice(cuts[number], cuts[number + 1])
            springs = Springs(where[edges[some, 0]], where[edges[some, 1]], stiffness[some])
            signs = scatter(patch, 1) - 0.5
            n_joined = self.cut.n_joined(len(patch), len(leaves[number]))
            return solve_patch(leaves[number], springs, signs, n_joined, self.errors, each)

        if self.n_threads == 1:
            return list(map(solved, numbers))
        with ThreadPoolExecutor(self.n_threads) as pool:
            if several or self.cut.leaf >= self.cut.patch:
                return list(pool.map(solved, numbers))
            return [solved(number, pool.map) for number in numbers]

    @cached_property
    def order(self) -> Ints:
        """Number of each mode, patch after patch, by its rank in the patch over its size."""
        return by_rank([len(patch) for patch in self.patches])

    def analyse(self, values: Floats) -> Floats:
        """Values at the vertices to coefficients, (rows, vertices) to (rows, modes)."""
        parts = [
            basis.analyse(values[:, patch])
            for patch, basis in zip(self.patches, self._all, strict=True)
        ]
        return np.concatenate(parts, axis=1)[:, self.order]

    def synthesise(self, coefficients: Floats, where: Ints | None = None) -> Floats:
        """Coefficients to values, (rows, first modes) to (rows, vertices), or some of these."""
        n_rows, n_modes = coefficients.shape
        flat = np.zeros((n_rows, self.n_vertices))
        flat[:, self.order[:n_modes]] = coefficients
        starts = np.cumsum([0, *map(len, self.patches)]).tolist()
        if where is None:
            values = np.empty((n_rows, self.n_vertices))
            for number, (patch, basis) in enumerate(zip(self.patches, self._all, strict=True)):
                values[:, patch] = basis.synthesise(flat[:, starts[number] : starts[number + 1]])
            return values
        owner, place = self._places
        values = np.empty((n_rows, len(where)))
        needed = np.unique(owner[where]).tolist()
        for number, basis in zip(needed, self.bases(needed), strict=True):
            there = owner[where] == number
            part = basis.synthesise(flat[:, starts[number] : starts[number + 1]])
            values[:, there] = part[:, place[where[there]]]
        return values

    @property
    def _all(self) -> list[PatchBasis]:
        return self.bases(range(len(self.patches)))

    @cached_property
    def shaken(self) -> PatchModes:
        """The same modes with errors that are larger than those of rounding."""
        return replace(self, errors=Shaken(ROUNDING))

    def pieces(self, largest: int) -> list[Ints]:
        """Vertices of the connected parts of the mesh, halved until none is larger."""
        return patches_of(self.edges, self.n_vertices, largest)

    def probe(self) -> Ints:
        """Look at a few entries of the basis, (8,) int64, in 1/4096."""
        (basis,) = self.bases([int(np.argmax([len(patch) for patch in self.patches]))])
        places = np.arange(PROBES)
        chosen = np.zeros((PROBES, basis.n))
        chosen[places, (places * basis.n) // PROBES] = 1.0
        entries = basis.synthesise(chosen)[places, (places * 7919 + 11) % basis.n]
        probe: Ints = np.rint(entries / PROBE_STEP).astype(np.int64)
        return probe

    def write(self) -> bytes:
        """Write which modes these are, and a probe of them."""
        cut = self.cut
        head = bytes([SPRINGS]) + write_varint(cut.patch) + write_varint(cut.leaf)
        return head + bytes([cut.share]) + struct.pack(f"<{PROBES}h", *self.probe().tolist())


def read_patch_modes(
    data: bytes, n_vertices: int, faces: Ints, n_threads: int = 1, *, whole: bool = True
) -> PatchModes:
    """Solve for the modes that `PatchModes.write` wrote, or of one patch first to compare them.

    Raises
    ------
    IndexError, ValueError, struct.error
        If they make no sense.
    MalformedFileError
        If they are not those of the encoder.
    LimitError
        If solving for them would take too long.
    """
    (patch, leaf), position = read_varints(data, 1, 2)
    share = data[position]
    probe = np.array(struct.unpack_from(f"<{PROBES}h", data, position + 1), dtype=np.int64)
    if not 1 <= leaf <= patch or position + 1 + 2 * PROBES != len(data):
        raise ValueError
    cut = Cut(min(patch, n_vertices), min(leaf, n_vertices), share)
    if cut.patch > LARGEST_PATCH or cut.work(n_vertices) > MOST_WORK:
        raise LimitError(
            f"Patches of {cut.patch} vertices of a mesh of {n_vertices} take too long to solve.",
            remedy="No encoder of this project writes such a stream: refuse its sender.",
            limit="spring_modes",
        )
    modes = PatchModes(edges_of(faces), n_vertices, cut, n_threads=n_threads)
    if whole:
        modes.bases(range(len(modes.patches)))
    if np.abs(modes.probe() - probe).max() > 1:
        raise MalformedFileError(
            "This machine solves for other spring modes than the encoder did.",
            remedy="Encode the sequence on this machine.",
        )
    return modes


LATTICE: Final = 1
"""First byte of the section of these modes."""

ENDS: Final = (OPEN, CLOSED, POLE_OPEN, POLE_POLE)
"""Ends of an axis by their code in a stream."""


# Numbers of the rows that are transformed together.
_AT_ONCE: Final = 2**14


@dataclass(frozen=True, eq=False)
class LatticeModes:
    """The modes of a lattice, smoothest first.

    Products of one function an axis, orthonormal over the nodes. On a torus these are
    cos a cos b, ..., which span what cos(a + b), ... span.

    Parameters
    ----------
    topology : Topology
    shape : tuple of int
        Nodes along each axis.
    fineness : tuple of int
        One number from 1 to 255 for each axis, in proportion to 1 / its length: it decides the
        order of the modes and nothing else.
    """

    topology: Topology
    shape: tuple[int, ...]
    fineness: tuple[int, ...]

    @cached_property
    def order(self) -> NDArray[np.int64]:
        """Number of the product of each mode, row by row; by wavenumber, then by number."""
        key = np.zeros(self.shape, dtype=np.int64)
        for axis, (ends, n, fine) in enumerate(
            zip(self.topology.ends, self.shape, self.fineness, strict=True)
        ):
            quarter = _quarter_periods(ends == CLOSED, n)
            along = np.expand_dims(quarter, [a for a in range(len(self.shape)) if a != axis])
            if ends not in (OPEN, CLOSED):
                # Odd about the pole: a quarter period more on a cup, half a one on a sphere.
                odd = self._odd_at_pole(axis)
                along = along + odd * (1 if ends == POLE_OPEN else 2)
            key += (fine * along) ** 2
        return np.argsort(key.ravel(), kind="stable")

    def analyse(self, values: Floats) -> Floats:
        """Values at the nodes to coefficients, (rows, nodes) to (rows, modes)."""
        array = values.reshape(-1, *self.shape)
        for axis in self._axes():
            array = self._along(array, axis, inverse=False)
        return array.reshape(len(values), -1)[:, self.order]

    def synthesise(self, coefficients: Floats, where: Ints | None = None) -> Floats:
        """Coefficients to values, (rows, first modes) to (rows, nodes), or some of these."""
        n_rows, n_modes = coefficients.shape
        n_nodes = prod(self.shape)
        n_values = n_nodes if where is None else len(where)
        values, places = np.empty((n_rows, n_values)), self.order[:n_modes]
        # A few rows at once: what stands between the steps stays in the cache, and in memory that
        # the process has already.
        n_at_once = max(1, _AT_ONCE // n_nodes)
        for start in range(0, n_rows, n_at_once):
            rows = slice(start, start + n_at_once)
            flat = np.zeros((len(values[rows]), n_nodes))
            flat[:, places] = coefficients[rows]
            array = flat.reshape(-1, *self.shape)
            for axis in reversed(self._axes()):
                array = self._along(array, axis, inverse=True)
            found = array.reshape(-1, n_nodes)
            values[rows] = found if where is None else found[:, where]
        return values

    @property
    def shaken(self) -> None:
        """None: no solver decides these modes."""
        return

    def pieces(self, largest: int) -> None:
        """None: they have no pieces."""

    def write(self) -> bytes:
        """Write which modes these are."""
        parts = [bytes([LATTICE, len(self.shape)])]
        for ends, n, fine in zip(self.topology.ends, self.shape, self.fineness, strict=True):
            parts += [bytes([ENDS.index(ends), fine]), write_varint(n)]
        return b"".join(parts)

    def _axes(self) -> list[int]:
        """List closed axes first: a pole axis depends on the turns around it."""
        ends = self.topology.ends
        return sorted(range(len(ends)), key=lambda axis: ends[axis] != CLOSED)

    def _odd_at_pole(self, axis: int) -> NDArray[np.int64]:
        """1 where the number of turns of the axis after this one is odd."""
        n = self.shape[axis + 1]
        turns = _quarter_periods(True, n) // 4
        others = [a for a in range(len(self.shape)) if a != axis + 1]
        return np.expand_dims(turns % 2, others)

    def _along(self, array: Floats, axis: int, *, inverse: bool) -> Floats:
        ends, place = self.topology.ends[axis], axis + 1
        if ends == CLOSED:
            return turn_back(array, place) if inverse else turn(array, place)
        even = (from_cosines if inverse else cosines)(array, place)
        if ends == OPEN:
            return even
        if ends == POLE_OPEN:
            odd = odd_sines(array, place)
        else:
            odd = (from_sines if inverse else sines)(array, place)
        return np.where(self._odd_at_pole(axis)[None] == 1, odd, even)


def read_lattice_modes(data: bytes, n_vertices: int) -> LatticeModes:
    """Read modes that `LatticeModes.write` wrote.

    Raises
    ------
    IndexError, ValueError
        If they make no sense, or are not those of so many vertices.
    """
    ends, shape, fineness, position = [], [], [], 2
    for _ in range(data[1]):
        ends.append(ENDS[data[position]])
        fineness.append(data[position + 1])
        n, position = read_varint(data, position + 2)
        shape.append(n)
    topology = Topology(tuple(ends))
    if prod(shape) != n_vertices or position != len(data):
        raise ValueError
    require_shape(topology, tuple(shape))
    return LatticeModes(topology, tuple(shape), tuple(fineness))


def _quarter_periods(closed: bool, n: int) -> NDArray[np.int64]:
    """Quarter periods along an axis of each of its functions."""
    index = np.arange(n)
    return 4 * ((index + 1) // 2) if closed else 2 * index


STORED: Final = b"\x00"

_UNKNOWN: Final = "This decoder does not know the modes of the stream."


class OrthonormalModes(Protocol):
    """A basis of the vertices, orthonormal or nearly so, smoothest modes first."""

    def analyse(self, values: Floats) -> Floats:
        """Values to coefficients, (rows, vertices) to (rows, modes)."""

    def synthesise(self, coefficients: Floats, where: Ints | None = None) -> Floats:
        """Coefficients of the first modes to values, (rows, modes) to (rows, vertices).

        At some vertices only if they are stated; what they do not need is not solved for.
        """

    @property
    def shaken(self) -> OrthonormalModes | None:
        """The same modes with errors larger than rounding; None if none are solved for."""

    def pieces(self, largest: int) -> list[Ints] | None:
        """Vertices of the pieces of the connectivity; None if the modes do not know it."""

    def write(self) -> bytes:
        """Write which modes these are, and a probe of those that are solved for."""


def read_modes(
    data: bytes, n_vertices: int, faces: Ints, n_threads: int = 1, *, whole: bool = True
) -> OrthonormalModes:
    """Make the modes that a stream names, with so many threads; not all at once unless whole.

    Raises
    ------
    MalformedFileError
        If they make no sense, or are not those of the encoder.
    LimitError
        If solving for them would take too long.
    """
    with parsing(_UNKNOWN):
        if data[0] == LATTICE:
            return read_lattice_modes(data, n_vertices)
        if data[0] == SPRINGS:
            return read_patch_modes(data, n_vertices, faces, n_threads, whole=whole)
    raise damaged(_UNKNOWN)
