"""Spring modes: eigenvectors of a mesh of springs, where no closed form applies.

They depend on the connectivity alone. Frequencies that coincide (symmetric or repeated parts)
would leave their modes undetermined, so every spring is stiffened a little, by an amount that
its two ends decide: then no two frequencies coincide, and each mode is one vector whose sign
is fixed by a rule. How far rounding can turn the modes is bounded by the gaps between the
frequencies; encoder and decoder compare a probe of the basis.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.codec.bits.varint import read_varint, write_varint
from modalmotion.errors import LimitError, MalformedFileError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SPRINGS: Final = 2
"""First byte of the section of these modes."""

LARGEST_PATCH: Final = 4096
# Square of the largest patch times the number of vertices, in proportion to the time to decode.
MOST_WORK: Final = 2.0e11
PROBES: Final = 8
PROBE_STEP: Final = 1.0 / 4096.0


@dataclass(frozen=True, eq=False)
class PatchModes:
    """Spring modes of patches of a mesh, smoothest first.

    Parameters
    ----------
    edges : (edges, 2) int64
        Pairs of vertices joined by a spring, each once, smaller first, sorted.
    n_vertices : int
    largest_patch : int
        Vertices of the largest patch; a larger component is halved until it fits.
    seed : int
        Decides how springs are stiffened.
    """

    edges: Ints
    n_vertices: int
    largest_patch: int
    seed: int

    @cached_property
    def patches(self) -> list[Ints]:
        """Vertices of each patch, ascending."""
        ones = np.ones(len(self.edges))
        half = scipy.sparse.coo_array(
            (ones, (self.edges[:, 0], self.edges[:, 1])), shape=(self.n_vertices,) * 2
        ).tocsr()
        graph = (half + half.T).tocsr()
        graph.sort_indices()
        todo = _components(graph, np.arange(self.n_vertices))
        done: list[Ints] = []
        while todo:
            part = todo.pop()
            if len(part) <= self.largest_patch:
                done.append(part)
                continue
            part_graph = graph[part][:, part]
            far = scipy.sparse.csgraph.breadth_first_order(
                part_graph, 0, directed=False, return_predecessors=False
            )[-1]
            order = scipy.sparse.csgraph.breadth_first_order(
                part_graph, far, directed=False, return_predecessors=False
            )
            middle = len(order) // 2
            for side in (order[:middle], order[middle:]):
                todo.extend(_components(graph, part[np.sort(side)]))
        return sorted(done, key=lambda part: int(part[0]))

    @cached_property
    def solution(self) -> tuple[list[Floats], list[Floats]]:
        """Frequencies squared and modes of each patch, for unit stiffness and mass.

        Returns
        -------
        list of (n,) float64
        list of (n, n) float64
            Modes in the columns, orthonormal, signs fixed.
        """
        squares, modes = [], []
        stiffness = 1.0 + _scatter(self.edges[:, 0] * 2**20 + self.edges[:, 1], self.seed) / 8.0
        where = np.full(self.n_vertices, -1)
        owner = np.empty(self.n_vertices, dtype=np.int64)
        for number, patch in enumerate(self.patches):
            owner[patch] = number
            where[patch] = np.arange(len(patch))
        inside = owner[self.edges[:, 0]] == owner[self.edges[:, 1]]
        edges, stiffness = self.edges[inside], stiffness[inside]
        order = np.argsort(owner[edges[:, 0]], kind="stable")
        edges, stiffness = edges[order], stiffness[order]
        cuts = np.searchsorted(owner[edges[:, 0]], np.arange(len(self.patches) + 1))
        for number, patch in enumerate(self.patches):
            part = slice(cuts[number], cuts[number + 1])
            a, b = where[edges[part, 0]], where[edges[part, 1]]
            K = np.zeros((len(patch), len(patch)))
            K[a, b] = K[b, a] = -stiffness[part]
            np.fill_diagonal(K, -K.sum(axis=1))
            square, Phi = scipy.linalg.eigh(K, driver="evd", overwrite_a=True, check_finite=False)
            signs = np.sign(_scatter(patch, self.seed + 1) @ Phi - Phi.sum(axis=0) / 2.0)
            squares.append(square)
            modes.append(Phi * np.where(signs == 0, 1.0, signs))
        return squares, modes

    @cached_property
    def order(self) -> Ints:
        """Number of each mode, patch after patch, by its rank in its patch over the patch's size.

        Ranks, not frequencies: the order does not depend on rounding.
        """
        sizes = np.array([len(patch) for patch in self.patches], dtype=np.int64)
        rank = np.arange(self.n_vertices) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        key = (2 * rank + 1) * (1 << 30) // np.repeat(sizes, sizes)
        # The translations of all patches first, large or small.
        key[rank == 0] = -1
        return np.argsort(key, kind="stable")

    def analyse(self, values: Floats) -> Floats:
        """Values at the vertices to coefficients, (rows, vertices) to (rows, modes)."""
        parts = [
            values[:, patch] @ Phi
            for patch, Phi in zip(self.patches, self.solution[1], strict=True)
        ]
        return np.concatenate(parts, axis=1)[:, self.order]

    def synthesise(self, coefficients: Floats) -> Floats:
        """Coefficients to values, (rows, first modes) to (rows, vertices)."""
        n_rows, n_modes = coefficients.shape
        flat = np.zeros((n_rows, self.n_vertices))
        flat[:, self.order[:n_modes]] = coefficients
        values = np.empty((n_rows, self.n_vertices))
        start = 0
        for patch, Phi in zip(self.patches, self.solution[1], strict=True):
            part = flat[:, start : start + len(patch)]
            used = int(np.flatnonzero(part.any(axis=0)).max(initial=-1)) + 1
            values[:, patch] = part[:, :used] @ Phi[:, :used].T
            start += len(patch)
        return values

    @cached_property
    def uncertainty(self) -> Floats:
        """How far rounding can move a vertex, for a unit of each mode.

        Rounding turns a mode towards its neighbour in frequency by an angle that is the error
        of the matrix over the gap between the two.

        Returns
        -------
        (modes,) float64
            In the order of the coefficients.
        """
        bounds = []
        for square, Phi in zip(*self.solution, strict=True):
            gaps = np.diff(square, prepend=-np.inf, append=np.inf)
            gap = np.minimum(gaps[:-1], gaps[1:])
            largest = max(float(square[-1]), 1.0)
            peak = np.pad(np.abs(Phi).max(axis=0), 1)
            peak = np.maximum(np.maximum(peak[:-2], peak[2:]), peak[1:-1])
            with np.errstate(divide="ignore"):
                bounds.append(1e-14 * largest / gap * peak)
        uncertainty: Floats = np.concatenate(bounds)[self.order]
        return uncertainty

    def probe(self) -> Ints:
        """Look at a few entries of the basis, (8,) int64, in 1/4096."""
        squares, modes = self.solution
        largest = int(np.argmax([len(square) for square in squares]))
        Phi = modes[largest]
        n = len(Phi)
        places = np.arange(PROBES)
        rows, columns = (places * 7919 + 11) % n, (places * n) // PROBES
        probe: Ints = np.rint(Phi[rows, columns] / PROBE_STEP).astype(np.int64)
        return probe

    def write(self) -> bytes:
        """Write which modes these are, and a probe of them."""
        head = bytes([SPRINGS, self.seed]) + write_varint(self.largest_patch)
        return head + struct.pack(f"<{PROBES}h", *self.probe().tolist())


def read_patch_modes(data: bytes, n_vertices: int, faces: Ints) -> PatchModes:
    """Solve for the modes that `PatchModes.write` wrote.

    Raises
    ------
    IndexError, ValueError, struct.error
        If they make no sense.
    MalformedFileError
        If they are not those of the encoder.
    LimitError
        If solving for them would take too long.
    """
    largest, position = read_varint(data, 2)
    probe = np.array(struct.unpack_from(f"<{PROBES}h", data, position), dtype=np.int64)
    if largest < 1 or position + 2 * PROBES != len(data):
        raise ValueError
    largest = min(largest, n_vertices)
    if largest > LARGEST_PATCH or float(largest) ** 2 * n_vertices > MOST_WORK:
        raise LimitError(
            f"Patches of {largest} vertices of a mesh of {n_vertices} take too long to solve.",
            remedy="No encoder of this project writes such a stream: refuse its sender.",
            limit="spring_modes",
        )
    modes = PatchModes(edges_of(faces), n_vertices, largest, data[1])
    if np.abs(modes.probe() - probe).max() > 1:
        raise MalformedFileError(
            "This machine solves for other spring modes than the encoder did.",
            remedy="Encode the sequence on this machine.",
        )
    return modes


def edges_of(faces: Ints) -> Ints:
    """Edges of triangles, each once, smaller vertex first, sorted; no loops."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    pairs = np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1)
    unique: Ints = np.unique(pairs, axis=0)
    return unique


def _components(graph: scipy.sparse.csr_array, part: Ints) -> list[Ints]:
    _, label = scipy.sparse.csgraph.connected_components(graph[part][:, part], directed=False)
    order = np.argsort(label, kind="stable")
    return np.split(part[order], np.flatnonzero(np.diff(label[order])) + 1)


def _scatter(numbers: Ints, seed: int) -> Floats:
    """Numbers in [0, 1) that look random: the high bits of a product modulo 2^32."""
    mixed = (numbers.astype(np.uint64) + np.uint64(977 * seed + 1)) * np.uint64(2654435761)
    mixed = (mixed ^ (mixed >> np.uint64(15))) * np.uint64(2246822519) & np.uint64(0xFFFFFFFF)
    mixed = (mixed ^ (mixed >> np.uint64(13))) * np.uint64(3266489917) & np.uint64(0xFFFFFFFF)
    return (mixed >> np.uint64(8)).astype(np.float64) / 2.0**24
