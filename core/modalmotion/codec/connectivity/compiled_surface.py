"""Faces of a mesh by the compiled kernel: the same bytes as in Python."""

from __future__ import annotations

from typing import Final

import numpy as np

from modalmotion.codec.bits.entropy import Ints, Reader, Writer
from modalmotion.codec.machine import places
from modalmotion.codec.machine.image import image
from modalmotion.codec.machine.memory import call

# Keys of the hash table for each triangle and vertex of common meshes.
_KEYS_EACH: Final = 24
_SHORT_LISTS: Final = 128
_AROUND: Final = 512
_WALKED: Final = 128
_RELATED: Final = 4 * (1 + 6 * 4 * 13)
_SOURCES: Final = 60 + 128


def write_surface(
    n_vertices: int,
    faces: Ints,
    period: int,
    n_relations: int,
    keep_order: bool,
    *,
    walk_only: bool = False,
) -> bytes:
    """Write triangles, and unless they are all that is wanted the order of the vertices.

    Parameters
    ----------
    n_vertices : int
    faces : (faces, 3) int64
    period : int
        Triangles after which the pattern may repeat.
    n_relations : int
    keep_order : bool
        Whether to keep the order of the triangles, and the first corner of each.
    walk_only : bool, optional
    """
    writer = Writer()
    parameters = len(faces), period, n_relations, int(keep_order), int(walk_only)
    _call(writer, n_vertices, parameters, faces)
    return writer.finish()


def read_surface(data: bytes, n_faces: int, n_vertices: int, period: int, n_relations: int) -> Ints:
    """Read triangles.

    Raises
    ------
    MalformedFileError
        If the bytes are not triangles of these vertices.
    """
    w = _call(Reader(data), n_vertices, (n_faces, period, n_relations, 0, 0), None)
    numbers = np.empty(n_vertices, dtype=np.int64)
    nodes, met = w[places.NODES], w[places.MET]
    numbers[w[nodes : nodes + n_vertices]] = np.arange(n_vertices)
    faces: Ints = numbers[w[met : met + 3 * n_faces]].reshape(-1, 3)
    return faces


def _call(
    coder: Writer | Reader, n_vertices: int, parameters: tuple[int, ...], faces: Ints | None
) -> Ints:
    compiled = image()
    assert compiled is not None  # noqa: S101 - who calls has looked
    n_faces, period, n_relations = parameters[:3]
    n, n_corners = n_vertices, 3 * n_faces
    parts: dict[int, Ints | int] = {
        places.MET: n_corners,
        places.AT_ROLE: 3 * period,
        places.EDGES: 7 * (n_corners + 1),
        places.RING: n + 1,
        places.RINGS: 2 * n_corners,
        places.BACK: 2 * n_corners,
        places.FIRST_PAIR: n + 1,
        places.PAIRS: 2 * n_corners,
        places.RELATED: _RELATED if n_relations else 4,
        places.SMALL: _SHORT_LISTS,
        places.AROUND: _AROUND,
        places.PARENTS: _AROUND,
        places.ENTERED: _AROUND,
        places.WAY: n + _AROUND,
        places.TURNS: _WALKED,
        places.PROPOSED: 5 * (n + _RELATED),
        places.SOURCES: 2 * (n + _RELATED),
        places.TRUST: _SOURCES + 6 * (n + 1),
    }
    for_each_node = (
        places.PIVOTS,
        places.N_AROUND,
        places.OLDER,
        places.NEWER,
        places.LAST_AHEAD,
        places.LAST_BEHIND,
        places.NUMBER,
        places.NODES,
        places.DISTANCE,
        places.FREE_AT,
        places.STAMP,
        places.QUEUE,
        places.SEEN,
        places.AFTER,
        places.HAS_AFTER,
        places.HAS_BEFORE,
        places.IN_RING,
        places.SLOT,
    )
    parts |= dict.fromkeys(for_each_node, n)
    if faces is not None:
        parts[places.TRIANGLES] = faces
        parts[places.NODE_OF] = np.full(n, -1)
        parts[places.NEXT_BESIDE] = n_corners
        parts[places.USED] = n_faces
    return call(
        compiled,
        "surface",
        coder,
        (n_vertices, *parameters),
        parts,
        n_keys=_KEYS_EACH * (n_faces + n),
        by_key={places.PATHS: 2, places.STEPS: 4},
        n_spare=n + _AROUND,
    )
