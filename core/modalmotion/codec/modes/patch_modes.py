"""Spring modes of a mesh in patches, where no closed form applies.

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
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.coder import read_varints, write_varint
from modalmotion.codec.modes.graph import edges_of, patches_of, scatter, stiffness_of
from modalmotion.codec.modes.joined import Each, PatchBasis, Shaken, Springs, by_rank, solve_patch
from modalmotion.errors import LimitError, MalformedFileError

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
