"""Connectivity: triangles in their orientation, and the order of the vertices, without loss.

Two passes: the triangles of nodes numbered as a walk meets them, then which node each vertex is;
`native/triangles.h` and `native/order.h` code them.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.coder import Coder, damaged
from modalmotion.modes.topology import CLOSED, Topology

Ints = NDArray[np.int64]
Grid = tuple[Topology, tuple[int, ...]]

MOST_RELATIONS: Final = 6
LARGEST_RELATED: Final = 10_000
"""Vertices of the largest mesh whose numbering uses relations: smaller, but slower."""

_NONSENSE: Final = "The faces of the stream make no sense."
_WALK: Final = 0
_CELLS: Final = 1
_PERIODS: Final = (1, 2, 8, 32)
_PATTERN_BITS: Final = 13


def write_faces(
    n_vertices: int,
    grid: Grid | None,
    faces: Ints,
    *,
    keep_order: bool,
    n_relations: tuple[int, ...] = (MOST_RELATIONS,),
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
    n_relations : tuple of int, optional
        Numbers of relations that the numbering of the vertices may use: the smallest wins.
    """
    cells = None if grid is None else _cells_of(grid, faces)
    if cells is not None:
        return bytes([_CELLS]) + np.packbits(cells).tobytes()

    def coded(period: int, n_relations: int, *, walk_only: bool) -> bytes:
        coder, shape = Coder(), (n_vertices, len(faces), period, n_relations)
        coder.faces(shape, faces, keep_order=keep_order, walk_only=walk_only)
        return bytes([_WALK, period, n_relations]) + coder.finish()

    period = 1
    if keep_order:
        period = min(_PERIODS, key=lambda period: len(coded(period, 0, walk_only=True)))
    if n_vertices > LARGEST_RELATED:
        n_relations = (0,)
    return min((coded(period, n, walk_only=False) for n in n_relations), key=len)


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
        faces = _faces_of(grid, pattern[:_PATTERN_BITS], n_faces) if len(pattern) == 16 else None
        if faces is None:
            raise damaged(_NONSENSE)
        return faces
    if len(data) < 3 or not data[1] or data[2] > MOST_RELATIONS:
        raise damaged(_NONSENSE)
    return Coder(data[3:]).faces((n_vertices, n_faces, data[1], data[2]), None)


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
        rebuilt = _faces_of(grid, pattern, len(faces))
        if rebuilt is not None and np.array_equal(rebuilt, faces):
            return pattern
    return None


def _faces_of(grid: Grid, pattern: NDArray[np.uint8], n_faces: int) -> Ints | None:
    topology, shape = grid
    if len(shape) != 2 or len(topology.ends) != 2:
        return None
    # A closed axis has one cell more, from its last node to its first.
    n_cells = [
        n if ends == CLOSED and n > 2 else n - 1
        for n, ends in zip(shape, topology.ends, strict=True)
    ]
    if min(n_cells) < 1 or 2 * n_cells[0] * n_cells[1] != n_faces:
        return None
    row, column = (i.reshape(-1, 1, 1) for i in np.indices(n_cells))
    steps = pattern[1:].astype(np.int64).reshape(1, 2, 3, 2)
    rows = (row + steps[..., 0]) % shape[0]
    columns = (column + steps[..., 1]) % shape[1]
    both = rows * shape[1] + columns
    if not pattern[0]:
        both = both.transpose(1, 0, 2)
    return np.ascontiguousarray(both.reshape(-1, 3))
