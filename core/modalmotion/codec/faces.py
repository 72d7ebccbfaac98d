"""Connectivity: triangles in their order and orientation, coded without loss."""

from __future__ import annotations

from collections import defaultdict
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.entropy import Counter, Ints, Reader, Writer
from modalmotion.codec.varint import unzigzag, zigzag
from modalmotion.codec.walk import BEHIND, NEARBY, NEW, SAME_ROLE, Walk, WalkRules
from modalmotion.errors import MalformedFileError
from modalmotion.topology import CLOSED, Topology

Grid = tuple[Topology, tuple[int, ...]]

_WALK: Final = 0
_CELLS: Final = 1
_RULES: Final = (WalkRules(1, NEARBY), WalkRules(2, SAME_ROLE), WalkRules(8, SAME_ROLE))
_CONTEXTS_OF_CHANGES: Final = 1 << 20
_REMEDY: Final = "The stream is damaged: send it again."


def write_faces(n_vertices: int, grid: Grid | None, faces: Ints, *, keep_order: bool) -> bytes:
    """Write triangles, at the least cost of a few rules.

    Parameters
    ----------
    n_vertices : int
    grid : (Topology, tuple of int), optional
        Lattice whose nodes the vertices are.
    faces : (faces, 3) int64
    keep_order : bool
        Whether the order of the triangles, and which corner of each comes first, is kept;
        otherwise they come fan by fan, in the same orientation.
    """
    cells = None if grid is None else _cells_of(grid, faces)
    if cells is not None:
        return bytes([_CELLS]) + np.packbits(cells).tobytes()
    rules = range(len(_RULES)) if keep_order else range(1)
    return min((_write_walk(n_vertices, faces, i, keep_order) for i in rules), key=len)


def read_faces(data: bytes, n_faces: int, n_vertices: int, grid: Grid | None) -> Ints:
    """Read triangles.

    Raises
    ------
    MalformedFileError
        If the bytes make no triangles of these vertices.
    """
    if not data or data[0] > _CELLS or (data[0] == _CELLS and grid is None):
        raise MalformedFileError("The faces of the stream make no sense.", remedy=_REMEDY)
    if data[0] == _CELLS and grid is not None:
        pattern = np.unpackbits(np.frombuffer(data[1:], np.uint8))
        faces = _faces_of(grid, pattern[:_PATTERN_BITS]) if len(pattern) == 16 else None
        if faces is None or len(faces) != n_faces:
            raise MalformedFileError("The faces of the stream make no sense.", remedy=_REMEDY)
        return faces
    if len(data) < 2 or data[1] >= len(_RULES):
        raise MalformedFileError("The faces of the stream make no sense.", remedy=_REMEDY)
    walk = Walk(n_vertices, _RULES[data[1]])
    counter = Counter(Reader(data[2:]))
    faces = np.empty((n_faces, 3), dtype=np.int64)
    drops = 0
    for face in faces:
        corner = 0
        while corner < 3:
            vertex = _code_corner(counter, walk, None, None)
            if vertex < 0:
                drops += 1
                if drops > n_vertices:
                    raise MalformedFileError("The faces never end.", remedy=_REMEDY)
                continue
            face[corner] = vertex
            corner += 1
    return faces


def _write_walk(n_vertices: int, faces: Ints, rule: int, keep_order: bool) -> bytes:
    walk = Walk(n_vertices, _RULES[rule])
    writer = Writer()
    counter = Counter(writer)
    if keep_order:
        for face in faces.tolist():
            for vertex in face:
                _code_corner(counter, walk, vertex, walk.symbol_of(vertex))
    else:
        _walk_fans(counter, walk, faces.tolist())
    return bytes([_WALK, rule]) + writer.finish()


def _walk_fans(counter: Counter, walk: Walk, faces: list[list[int]]) -> None:
    """Go round one pivot after the other."""
    beside: dict[tuple[int, int], list[int]] = defaultdict(list)
    for number, (a, b, c) in enumerate(faces):
        for edge in ((a, b), (b, c), (c, a)):
            beside[edge].append(number)
    used = [False] * len(faces)
    first_unused, n_left = 0, len(faces)
    while n_left:
        pivot = walk.pivot
        if pivot is None:
            while used[first_unused]:
                first_unused += 1
            number, pivot = first_unused, faces[first_unused][0]
        else:
            ends = walk.open_ends(pivot)
            waiting = (n for end in ends for n in beside[pivot, end] if not used[n])
            number = next(waiting, -1)
        if number < 0:
            _code_corner(counter, walk, -1, BEHIND)
            continue
        used[number] = True
        n_left -= 1
        face = faces[number]
        turn = face.index(pivot)
        for vertex in face[turn:] + face[:turn]:
            _code_corner(counter, walk, vertex, walk.symbol_of(vertex))


def _code_corner(counter: Counter, walk: Walk, vertex: int | None, symbol: int | None) -> int:
    """Code one corner; -1 where a pivot is given up."""
    first = walk.role % 3 == 0
    symbol = counter.code(walk.context, symbol)
    if first and symbol == BEHIND:
        if walk.pivot is None:
            raise MalformedFileError("The faces of the stream make no sense.", remedy=_REMEDY)
        walk.take(-1, symbol)
        return -1
    found = _code_new(counter, walk, vertex) if symbol == NEW else walk.vertex_of(symbol)
    if found < 0:
        raise MalformedFileError(
            "A face of the stream names a vertex that does not exist.", remedy=_REMEDY
        )
    walk.take(found, symbol)
    return found


def _code_new(counter: Counter, walk: Walk, vertex: int | None) -> int:
    context = _CONTEXTS_OF_CHANGES + 1
    if walk.rules.prediction == NEARBY:
        nearby = walk.nearby()
        place = None
        if vertex is not None:
            place = nearby.index(vertex) + 1 if vertex in nearby else 0
        place = counter.code(context, place)
        if place > len(nearby):
            return -1
        if place:
            return nearby[place - 1]
        context += 1
    else:
        context += 1 + walk.role
    change = None if vertex is None else zigzag(walk.change_of(vertex))
    return walk.new_vertex(unzigzag(counter.code(context, change)))


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
        found = _faces_of(grid, pattern)
        if found is not None and np.array_equal(found, faces):
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
