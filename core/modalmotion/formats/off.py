"""OFF text: counts, then one vertex a line, then one polygon a line.

Colours and normals that stand behind a vertex or a polygon are not used.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator
from functools import partial
from itertools import islice
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError
from modalmotion.formats.frames.frame import Frame, space_in
from modalmotion.formats.polygons import triangulate_sizes
from modalmotion.formats.text import lines_of, parse_points
from modalmotion.limits import NO_LIMITS, ReadLimits

# ST, C, N say what follows x, y and z on a line; the forms with 4 or n coordinates are others.
_KEYWORD: Final = re.compile(rb"(?:ST)?C?N?OFF(?=\s|$)")
_BLOCK_ROWS: Final = 30_000
_malformed: Final = partial(
    MalformedFileError,
    remedy="Export the frame again as OFF text: 'OFF', the counts, vertices, polygons.",
)


def read_off(data: bytes, limits: ReadLimits = NO_LIMITS) -> Frame:
    """Read one OFF file.

    Parameters
    ----------
    data : bytes
    limits : ReadLimits, optional

    Returns
    -------
    Frame

    Raises
    ------
    MalformedFileError
        If the bytes are not OFF text, or hold fewer or more than they declare.
    LimitError
        If it declares more than `limits` accept.
    """
    lines = _without_comments(data)
    first = next(lines, b"")
    keyword = _KEYWORD.match(first)
    if keyword is None:
        raise _malformed("The file does not begin with 'OFF'.")
    counts = first[keyword.end() :].split() or next(lines, b"").split()
    try:
        n_vertices, n_faces = (int(word) for word in counts[:2])
    except ValueError:
        raise _malformed(f"The OFF file has the counts {b' '.join(counts)[:40]!r}.") from None
    if n_vertices < 0 or n_faces < 0:
        raise _malformed("The OFF file has a negative count.")
    limits.require("vertices", n_vertices)
    limits.require("faces", n_faces)
    positions = _read_vertices(lines, n_vertices)
    sizes, corners = array("q"), array("q")
    for line in islice(lines, n_faces):
        words = line.split()
        try:
            size = int(words[0])
            polygon = array("q", map(int, words[1 : max(size, 0) + 1]))
        except (ValueError, OverflowError):
            size, polygon = -1, array("q")
        if len(polygon) != size:
            raise _malformed(f"Polygon {len(sizes)} of the OFF file reads {line[:40]!r}.")
        sizes.append(size)
        corners += polygon
    if len(sizes) != n_faces or next(lines, None) is not None:
        more = "fewer" if len(sizes) != n_faces else "more"
        raise _malformed(
            f"The OFF file declares {n_vertices} vertices and {n_faces} polygons, but {more} "
            "lines follow."
        )
    polygons = triangulate_sizes(sizes, corners)
    return Frame(positions, polygons.faces, notes=polygons.notes, statements=space_in(data[:1024]))


def _without_comments(data: bytes) -> Iterator[bytes]:
    for line in lines_of(data):
        if stripped := line.partition(b"#")[0].strip():
            yield stripped


def _read_vertices(lines: Iterator[bytes], n_vertices: int) -> NDArray[np.float64]:
    blocks = []
    n_read = 0
    while n_read < n_vertices:
        rows = [line.split()[:3] for line in islice(lines, min(_BLOCK_ROWS, n_vertices - n_read))]
        try:
            block = parse_points(rows)
        except ValueError as error:
            raise _malformed(
                f"A vertex of the OFF file is not a point ({str(error)[:60]})."
            ) from error
        if not rows:
            raise _malformed(
                f"The OFF file declares {n_vertices} vertices but ends after {n_read}."
            )
        blocks.append(block)
        n_read += len(rows)
    return np.concatenate(blocks) if blocks else np.zeros((0, 3))
