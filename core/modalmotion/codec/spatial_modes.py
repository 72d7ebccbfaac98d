"""Modes in space, of lattices and of the patches of meshes, and their section of a stream.

They depend on the connectivity alone. Frequencies that coincide (symmetric or repeated parts)
would leave their modes undetermined, so every spring is stiffened a little, by an amount that
its two ends decide: then no two frequencies coincide, and each mode is one vector whose sign
is fixed by a rule. How far rounding can turn the modes is seen by solving again with errors.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import prod
from typing import Final, Protocol

import numpy as np

from modalmotion.codec import coder, joined_modes, temporal
from modalmotion.errors import LimitError
from modalmotion.modes.topologies import CLOSED, OPEN, POLE_OPEN, POLE_POLE, Topology, require_shape
from modalmotion.representation import Floats, Ints

SPRINGS: Final = 2
"""First byte of the section of these modes."""

LARGEST_PATCH: Final = 4096
# Numbers in proportion to the time to decode, for each vertex: of the leaves, and of joining.
MOST_WORK: Final = 2.0e11
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
    errors : float
        Of each entry of a matrix, over its largest, to see what they do.
    """

    edges: Ints
    n_vertices: int
    cut: Cut
    errors: float = 0.0

    @cached_property
    def patches(self) -> list[Ints]:
        """Vertices of each patch, ascending."""
        return joined_modes.patches_of(self.edges, self.n_vertices, self.cut.patch)

    @cached_property
    def bases(self) -> list[joined_modes.PatchBasis]:
        """Modes of each patch, for unit stiffness and mass."""
        owner, where = np.empty((2, self.n_vertices), dtype=np.int64)
        for number, patch in enumerate(self.patches):
            owner[patch] = number
            where[patch] = np.arange(len(patch))
        edges = self.edges[owner[self.edges[:, 0]] == owner[self.edges[:, 1]]]
        edges = edges[np.argsort(owner[edges[:, 0]], kind="stable")]
        cuts = np.searchsorted(owner[edges[:, 0]], np.arange(len(self.patches) + 1))
        (a, b), stiffness = where[edges.T], joined_modes.stiffness_of(edges)
        leaves: list[list[Ints]] = [[] for _ in self.patches]
        parts = self.patches
        if self.cut.leaf < self.cut.patch:
            parts = joined_modes.patches_of(edges, self.n_vertices, self.cut.leaf)
        for part in parts:
            leaves[int(owner[part[0]])].append(where[part])
        bases = []
        for patch, own, start, end in zip(self.patches, leaves, cuts, cuts[1:], strict=False):
            springs = joined_modes.Springs(a[start:end], b[start:end], stiffness[start:end])
            n_joined = self.cut.n_joined(len(patch), len(own))
            bases.append(
                joined_modes.solve_patch(
                    own, springs, joined_modes.scatter(patch, 1) - 0.5, n_joined, self.errors
                )
            )
        return bases

    @cached_property
    def order(self) -> Ints:
        """Number of each mode, patch after patch, by its rank in the patch over its size."""
        return joined_modes.by_rank([len(patch) for patch in self.patches])

    def analyse(self, values: Floats) -> Floats:
        """Values at the vertices to coefficients, (rows, vertices) to (rows, modes)."""
        parts = [
            basis.analyse(values[:, patch])
            for patch, basis in zip(self.patches, self.bases, strict=True)
        ]
        return np.concatenate(parts, axis=1)[:, self.order]

    def synthesise(self, coefficients: Floats) -> Floats:
        """Coefficients to values, (rows, first modes) to (rows, vertices)."""
        n_rows, n_modes = coefficients.shape
        flat = np.zeros((n_rows, self.n_vertices))
        flat[:, self.order[:n_modes]] = coefficients
        values, at = np.empty((n_rows, self.n_vertices)), 0
        for patch, basis in zip(self.patches, self.bases, strict=True):
            values[:, patch] = basis.synthesise(flat[:, at : at + len(patch)])
            at += len(patch)
        return values

    @cached_property
    def shaken(self) -> "PatchModes":
        """The same modes with errors that are larger than those of rounding."""
        return replace(self, errors=ROUNDING)

    def pieces(self, largest: int) -> list[Ints]:
        """Vertices of the connected parts of the mesh, halved until none is larger."""
        return joined_modes.patches_of(self.edges, self.n_vertices, largest)

    def write(self) -> bytes:
        """Write which modes these are."""
        cut = self.cut
        sizes = coder.write_varint(cut.patch) + coder.write_varint(cut.leaf)
        return bytes([SPRINGS]) + sizes + bytes([cut.share])


def read_patch_modes(data: bytes, n_vertices: int, faces: Ints) -> PatchModes:
    """Read modes that `PatchModes.write` wrote.

    Raises
    ------
    IndexError, ValueError
        If they make no sense.
    LimitError
        If solving for them would take too long.
    """
    (patch, leaf), position = coder.read_varints(data, 1, 2)
    share = data[position]
    if not 1 <= leaf <= patch or position + 1 != len(data):
        raise ValueError
    cut = Cut(min(patch, n_vertices), min(leaf, n_vertices), share)
    if cut.patch > LARGEST_PATCH or cut.work(n_vertices) > MOST_WORK:
        raise LimitError(
            f"Patches of {cut.patch} vertices of a mesh of {n_vertices} would take too long to "
            "solve.",
            remedy="No encoder of this project writes such a stream: do not trust its sender.",
            limit="spring_modes",
        )
    return PatchModes(joined_modes.edges_of(faces), n_vertices, cut)


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
    def order(self) -> Ints:
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

    def synthesise(self, coefficients: Floats) -> Floats:
        """Coefficients to values, (rows, first modes) to (rows, nodes)."""
        n_rows, n_modes = coefficients.shape
        n_nodes = prod(self.shape)
        values, places = np.empty((n_rows, n_nodes)), self.order[:n_modes]
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
            values[rows] = array.reshape(-1, n_nodes)
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
            parts += [bytes([ENDS.index(ends), fine]), coder.write_varint(n)]
        return b"".join(parts)

    def _axes(self) -> list[int]:
        """List closed axes first: a pole axis depends on the turns around it."""
        ends = self.topology.ends
        return sorted(range(len(ends)), key=lambda axis: ends[axis] != CLOSED)

    def _odd_at_pole(self, axis: int) -> Ints:
        """1 where the number of turns of the axis after this one is odd."""
        n = self.shape[axis + 1]
        turns = _quarter_periods(True, n) // 4
        others = [a for a in range(len(self.shape)) if a != axis + 1]
        return np.expand_dims(turns % 2, others)

    def _along(self, array: Floats, axis: int, *, inverse: bool) -> Floats:
        ends, place = self.topology.ends[axis], axis + 1
        if ends == CLOSED:
            return temporal.turn_back(array, place) if inverse else temporal.turn(array, place)
        even = (temporal.from_cosines if inverse else temporal.cosines)(array, place)
        if ends == OPEN:
            return even
        if ends == POLE_OPEN:
            odd = temporal.odd_sines(array, place)
        else:
            odd = (temporal.from_sines if inverse else temporal.sines)(array, place)
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
        n, position = coder.read_varint(data, position + 2)
        shape.append(n)
    topology = Topology(tuple(ends))
    if prod(shape) != n_vertices or position != len(data):
        raise ValueError
    require_shape(topology, tuple(shape))
    return LatticeModes(topology, tuple(shape), tuple(fineness))


def _quarter_periods(closed: bool, n: int) -> Ints:
    """Quarter periods along an axis of each of its functions."""
    index = np.arange(n)
    return 4 * ((index + 1) // 2) if closed else 2 * index


STORED: Final = b"\x00"

_UNKNOWN: Final = "The stream uses a kind of modes that this decoder does not know."


class OrthonormalModes(Protocol):
    """A basis of the vertices, orthonormal or nearly so, smoothest modes first."""

    def analyse(self, values: Floats) -> Floats:
        """Values to coefficients, (rows, vertices) to (rows, modes)."""

    def synthesise(self, coefficients: Floats) -> Floats:
        """Coefficients of the first modes to values, (rows, modes) to (rows, vertices)."""

    @property
    def shaken(self) -> "OrthonormalModes | None":
        """The same modes with errors larger than rounding; None if none are solved for."""

    def pieces(self, largest: int) -> list[Ints] | None:
        """Vertices of the pieces of the connectivity; None if the modes do not know it."""

    def write(self) -> bytes:
        """Write which modes these are."""


def read_modes(data: bytes, n_vertices: int, faces: Ints) -> OrthonormalModes:
    """Make the modes that a stream names.

    Raises
    ------
    MalformedFileError
        If they make no sense.
    LimitError
        If solving for them would take too long.
    """
    with coder.parsing(_UNKNOWN):
        if data[0] == LATTICE:
            return read_lattice_modes(data, n_vertices)
        if data[0] == SPRINGS:
            return read_patch_modes(data, n_vertices, faces)
    raise coder.damaged(_UNKNOWN)
