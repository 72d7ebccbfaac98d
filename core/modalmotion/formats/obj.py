"""Wavefront OBJ: lines "v x y z" and "f a b c ...", all others skipped.

Corners may read a, a/b, a//c or a/b/c; only the vertex a counts, so texture seams and normals
neither split nor reorder vertices. Material files, textures, and the commands `call` and `csh`
are never followed.
"""

from __future__ import annotations

import re
from array import array
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError
from modalmotion.formats.frames.frame import Frame, space_in
from modalmotion.formats.polygons import triangulate_sizes
from modalmotion.formats.text import line_blocks, parse_points
from modalmotion.limits import NO_LIMITS, ReadLimits

KEYWORDS: Final = frozenset(
    b"v vt vn vp f l p o g s mg mtllib usemtl usemap maplib cstype deg bmat step curv curv2 surf "
    b"parm trim hole scrv sp end con bevel c_interp d_interp lod shadow_obj trace_obj ctech "
    b"stech call csh".split()
)
"""First words of lines that the format knows."""

# Texture and normal of a corner: everything from its first slash.
_AFTER_VERTEX: Final = re.compile(rb"/\S*")
# Starts of lines that are indented, or separated by tabs.
_UNUSUAL: Final = (b" ", b"\t", b"v\t", b"f\t")
_MOST_COMMENTS: Final = 20
_malformed: Final = partial(
    MalformedFileError, remedy="Export the frame again as OBJ, without free-form surfaces."
)


def read_obj(data: bytes, limits: ReadLimits = NO_LIMITS) -> Frame:
    """Read one OBJ file.

    Parameters
    ----------
    data : bytes
    limits : ReadLimits, optional

    Returns
    -------
    Frame
        Every "v" in the order of the file, whether a face uses it or not.

    Raises
    ------
    MalformedFileError
        If a vertex or face cannot be read, or it holds no vertex.
    LimitError
        If it holds more than `limits` accept.
    """
    if b"\\\n" in data or b"\\\r\n" in data:
        data = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    blocks = []
    n_vertices = 0
    sizes, corners = array("q"), array("q")
    others: dict[bytes, None] = {}
    comments: list[bytes] = []
    for lines in line_blocks(data):
        plain = _plain_block(lines)
        if plain is None:
            positions = _read_block(lines, n_vertices, sizes, corners)
        else:
            positions, triangles = plain
            corners += triangles
            sizes.extend([3] * (len(triangles) // 3))
        _note_others(lines, others, comments)
        blocks.append(positions)
        n_vertices += len(positions)
        limits.require("vertices", n_vertices)
        limits.require("faces", len(sizes))
    if not n_vertices:
        raise _malformed("The OBJ file contains no vertex.")
    polygons = triangulate_sizes(sizes, corners)
    return Frame(
        np.concatenate(blocks),
        polygons.faces,
        notes=polygons.notes,
        ignored=tuple(word.decode() for word in others),
        statements=space_in(b"".join(comments)),
    )


def _plain_block(lines: list[bytes]) -> tuple[NDArray[np.float64], array[int]] | None:
    """Read vertices and triangles in bulk; None if any line is unusual."""
    vertices = [line for line in lines if line.startswith(b"v ")]
    faces = [line for line in lines if line.startswith(b"f ")]
    text = b" ".join(faces)
    numbers = b" ".join(vertices).split()
    indices = (_AFTER_VERTEX.sub(b"", text) if b"/" in text else text).split()
    is_plain = (
        # Negative indices count back from the latest vertex, so the order of lines matters.
        b"-" not in text
        and len(numbers) == 4 * len(vertices)
        and len(indices) == 4 * len(faces)
        and numbers[::4].count(b"v") == len(vertices)
        and indices[::4].count(b"f") == len(faces)
        and not any(line.startswith(_UNUSUAL) for line in lines)
    )
    if not is_plain:
        return None
    del numbers[::4], indices[::4]
    try:
        positions = np.array(list(map(float, numbers))).reshape(-1, 3)
        corners = array("q", [int(word) - 1 for word in indices])
    except (ValueError, OverflowError):
        return None
    return None if corners and min(corners) < 0 else (positions, corners)


def _read_block(
    lines: list[bytes], n_vertices: int, sizes: array[int], corners: array[int]
) -> NDArray[np.float64]:
    """Read vertices and polygons one by one; returns the block's positions."""
    rows: list[list[bytes]] = []
    for line in lines:
        words = line.split()
        if words[:1] == [b"v"]:
            rows.append(words[1:4])
        elif words[:1] == [b"f"]:
            corners += _corners(words[1:], n_vertices + len(rows))
            sizes.append(len(words) - 1)
    return _positions(rows)


def _note_others(lines: list[bytes], others: dict[bytes, None], comments: list[bytes]) -> None:
    for line in lines:
        if line.startswith((b"v ", b"f ")):
            continue
        if line.lstrip().startswith(b"#"):
            if len(comments) < _MOST_COMMENTS:
                comments.append(line)
        elif words := line.split(None, 1):
            if words[0] not in KEYWORDS:
                raise _malformed(f"The OBJ file has a line {line[:40]!r}.")
            if words[0] not in (b"v", b"f"):
                others[words[0]] = None


def _corners(words: list[bytes], n_vertices: int) -> array[int]:
    try:
        numbers = [int(word.partition(b"/")[0]) for word in words]
        # Counted from one; from the last vertex so far where negative.
        corners = array("q", [n - 1 if n > 0 else n_vertices + n for n in numbers])
    except (ValueError, OverflowError):
        raise _malformed(f"A face of the OBJ file reads {b' '.join(words)[:40]!r}.") from None
    if numbers and (min(corners) < 0 or 0 in numbers):
        raise _malformed(
            f"A face of the OBJ file names vertex {min(numbers)}, but {n_vertices} are before "
            "it and counting starts at 1."
        )
    return corners


def _positions(rows: list[list[bytes]]) -> NDArray[np.float64]:
    try:
        return parse_points(rows)
    except ValueError as error:
        raise _malformed(f"A vertex of the OBJ file is not a point ({str(error)[:60]}).") from error
