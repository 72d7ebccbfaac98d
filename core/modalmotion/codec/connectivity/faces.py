"""Connectivity: triangles in their orientation, and the order of the vertices, without loss."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.bits.damage import damaged
from modalmotion.codec.bits.entropy import Ints, Reader, Writer
from modalmotion.codec.bits.mixing import Mixer
from modalmotion.codec.connectivity.compiled_surface import read_surface, write_surface
from modalmotion.codec.connectivity.numbering import MOST_RELATIONS, Numbering
from modalmotion.codec.connectivity.rings import Rings
from modalmotion.codec.connectivity.walk import BEHIND, GIVEN_UP, Walk
from modalmotion.codec.machine.image import image
from modalmotion.modes.topology import CLOSED, Topology

Grid = tuple[Topology, tuple[int, ...]]

_NONSENSE: Final = "The faces of the stream make no sense."
_WALK: Final = 0
_CELLS: Final = 1
_PERIODS: Final = (1, 2, 8, 32)
LARGEST_RELATED: Final = 10_000
"""Vertices of the largest mesh whose numbering uses relations: smaller, but slower."""


def write_faces(
    n_vertices: int,
    grid: Grid | None,
    faces: Ints,
    *,
    keep_order: bool,
    n_relations: int = MOST_RELATIONS,
) -> bytes:
    """Write triangles by the cheapest of a few rules.

    Parameters
    ----------
    n_vertices : int
    grid : (Topology, tuple of int), optional
        Lattice whose nodes the vertices are.
    faces : (faces, 3) int64
    keep_order : bool
        Whether to keep the order of the triangles, and the first corner of each;
        otherwise they come fan by fan, in the same orientation.
    n_relations : int, optional
        Relations that the numbering of the vertices uses, at most: smaller, but slower.
    """
    cells = None if grid is None else _cells_of(grid, faces)
    if cells is not None:
        return bytes([_CELLS]) + np.packbits(cells).tobytes()
    n_relations = n_relations if n_vertices <= LARGEST_RELATED else 0
    write = _write_surface if image() is None else write_surface
    period = 1
    if keep_order:
        sizes = {
            p: len(write(n_vertices, faces, p, n_relations, True, walk_only=True)) for p in _PERIODS
        }
        period = min(sizes, key=sizes.__getitem__)
    coded = write(n_vertices, faces, period, n_relations, keep_order)
    return bytes([_WALK, period, n_relations]) + coded


def _write_surface(
    n_vertices: int,
    faces: Ints,
    period: int,
    n_relations: int,
    keep_order: bool,
    *,
    walk_only: bool = False,
) -> bytes:
    written = _write_walk(n_vertices, faces.tolist(), period, keep_order)
    if not walk_only:
        nodes = written.nodes
        numbering = Numbering(written.mixer, Rings(n_vertices, written.triangles), n_relations)
        for vertex in range(n_vertices):
            numbering.code(nodes.get(vertex, len(nodes)))
    return written.writer.finish()


def read_faces(data: bytes, n_faces: int, n_vertices: int, grid: Grid | None) -> Ints:
    """Read triangles.

    Raises
    ------
    MalformedFileError
        If the bytes are not triangles of these vertices.
    """
    if not data or data[0] > _CELLS or (data[0] == _CELLS and grid is None):
        raise damaged(_NONSENSE)
    if data[0] == _CELLS and grid is not None:
        pattern = np.unpackbits(np.frombuffer(data[1:], np.uint8))
        faces = _faces_of(grid, pattern[:_PATTERN_BITS]) if len(pattern) == 16 else None
        if faces is None or len(faces) != n_faces:
            raise damaged(_NONSENSE)
        return faces
    if len(data) < 3 or not data[1] or data[2] > MOST_RELATIONS:
        raise damaged(_NONSENSE)
    read = _read_surface if image() is None else read_surface
    return read(data[3:], n_faces, n_vertices, data[1], data[2])


def _read_surface(
    data: bytes, n_faces: int, n_vertices: int, period: int, n_relations: int
) -> Ints:
    mixer = Mixer(Reader(data))
    walk = Walk(mixer, n_vertices, period)
    triangles: list[list[int]] = []
    face: list[int] = []
    while len(triangles) < n_faces:
        node = walk.code(None, None)
        if node == GIVEN_UP:
            continue
        face.append(node)
        if len(face) == 3:
            triangles.append(face)
            face = []
    numbering = Numbering(mixer, Rings(n_vertices, triangles), n_relations)
    for _ in range(n_vertices):
        numbering.code(None)
    numbers = np.empty(n_vertices, dtype=np.int64)
    numbers[numbering.nodes] = np.arange(n_vertices)
    labelled: Ints = numbers[np.array(triangles)]
    return labelled


@dataclass(frozen=True, eq=False)
class _Written:
    """Triangles of nodes, numbered in the order of the walk.

    Parameters
    ----------
    writer : Writer
    mixer : Mixer
    nodes : dict
        Node of each vertex of a triangle.
    triangles : list of [int, int, int]
        Nodes, in the order of writing.
    """

    writer: Writer
    mixer: Mixer
    nodes: dict[int, int]
    triangles: list[list[int]]


def _write_walk(
    n_vertices: int, triangles: list[list[int]], period: int, keep_order: bool
) -> _Written:
    writer = Writer()
    mixer = Mixer(writer)
    walk = Walk(mixer, n_vertices, period)
    nodes: dict[int, int] = {}
    met = []
    for face in triangles if keep_order else _fans(walk, triangles, nodes):
        if not face:
            walk.code(GIVEN_UP, BEHIND)
            continue
        for vertex in face:
            node = nodes.setdefault(vertex, walk.n_met)
            walk.code(node, walk.kind_of(node))
        met.append([nodes[vertex] for vertex in face])
    return _Written(writer, mixer, nodes, met)


def _fans(walk: Walk, triangles: list[list[int]], nodes: dict[int, int]) -> Iterator[list[int]]:
    """Go round one pivot after the other, as the walk goes on; an empty face gives the pivot up."""
    beside: dict[tuple[int, int], list[int]] = defaultdict(list)
    for number, (a, b, c) in enumerate(triangles):
        for edge in ((a, b), (b, c), (c, a)):
            beside[edge].append(number)
    used = [False] * len(triangles)
    first_unused, n_left = 0, len(triangles)
    vertices: list[int] = []
    while n_left:
        vertices.extend(islice(nodes, len(vertices), None))
        if walk.pivot is None:
            while used[first_unused]:
                first_unused += 1
            number, pivot = first_unused, triangles[first_unused][0]
        else:
            pivot = vertices[walk.pivot]
            ends = walk.open_ends(walk.pivot)
            waiting = (n for end in ends for n in beside[pivot, vertices[end]] if not used[n])
            number = next(waiting, -1)
        if number < 0:
            yield []
            continue
        used[number] = True
        n_left -= 1
        face = triangles[number]
        turn = face.index(pivot)
        yield face[turn:] + face[:turn]


_PATTERN_BITS: Final = 13


def _cells_of(grid: Grid, faces: Ints) -> NDArray[np.uint8] | None:
    """Pattern in which every cell of a lattice is cut into two triangles, if there is one.

    Returns
    -------
    (13,) uint8 or None
        Whether the two triangles of a cell follow each other, then for each of their corners
        the step along the first and the second axis.
    """
    shape = grid[1]
    if len(shape) != 2 or len(faces) < 2 or len(faces) % 2:
        return None
    columns = shape[1]
    for together in (1, 0):
        second = 1 if together else len(faces) // 2
        bits = [together]
        for face in (faces[0], faces[second]):
            for vertex in face.tolist():
                row, column = divmod(vertex, columns)
                bits += [min(row, 1), min(column, 1)]
        pattern = np.array(bits, dtype=np.uint8)
        rebuilt = _faces_of(grid, pattern)
        if rebuilt is not None and np.array_equal(rebuilt, faces):
            return pattern
    return None


def _faces_of(grid: Grid, pattern: NDArray[np.uint8]) -> Ints | None:
    topology, shape = grid
    if len(shape) != 2:
        return None
    # A closed axis has one cell more, from its last node to its first.
    n_cells = [
        n if ends == CLOSED and n > 2 else n - 1
        for n, ends in zip(shape, topology.ends, strict=True)
    ]
    row, column = (i.reshape(-1, 1, 1) for i in np.indices(n_cells))
    steps = pattern[1:].astype(np.int64).reshape(1, 2, 3, 2)
    rows = (row + steps[..., 0]) % shape[0]
    columns = (column + steps[..., 1]) % shape[1]
    both = rows * shape[1] + columns
    if not pattern[0]:
        both = both.transpose(1, 0, 2)
    return np.ascontiguousarray(both.reshape(-1, 3))
