"""Wavefront OBJ and OFF, and numbers in lines of text, read in bounded memory.

Of OBJ the lines "v x y z" and "f a b c ..." are read, all others skipped. Corners may read a, a/b,
a//c or a/b/c; only the vertex a counts, so texture seams and normals neither split nor reorder
vertices. Material files, textures, and the commands `call` and `csh` are never followed.

OFF is counts, then one vertex a line, then one polygon a line. Colours and normals after a vertex
or a polygon are not used.
"""

from __future__ import annotations

import io
import re
from array import array
from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice
from typing import Final

import numpy as np

from modalmotion.errors import MalformedFileError
from modalmotion.formats.frame import Frame, space_in, triangulate_sizes
from modalmotion.limits import NO_LIMITS, ReadLimits

_BLOCK: Final = 1 << 20
_LONGEST_LINE: Final = 1 << 20


def line_blocks(data: bytes | memoryview) -> Iterator[list[bytes]]:
    """Yield the lines of a text in blocks of about a megabyte.

    Splitting takes many times the memory of the text, so it is done block by block.

    Raises
    ------
    MalformedFileError
        If a line is longer than a megabyte, as no mesh needs.
    """
    stream = io.BytesIO(data)
    n_lines = 0
    while lines := stream.readlines(_BLOCK):
        for number, line in enumerate(lines, n_lines + 1):
            if len(line) > _LONGEST_LINE:
                raise MalformedFileError(
                    f"Line {number} is {len(line)} bytes long.",
                    remedy="Write one vertex or one face a line.",
                    details={"line": number},
                )
        n_lines += len(lines)
        yield lines


def lines_of(data: bytes | memoryview) -> Iterator[bytes]:
    """Yield the nonempty lines of a text, without the space around them."""
    for block in line_blocks(data):
        for line in block:
            if stripped := line.strip():
                yield stripped


def _point(words: list[bytes], malformed: Callable[[str], MalformedFileError]) -> list[float]:
    """Three coordinates in words."""
    if len(words) != 3:
        raise malformed(f"A vertex has {len(words)} coordinates in place of three.")
    try:
        return [float(word) for word in words]
    except ValueError:
        raise malformed(f"A vertex reads {b' '.join(words)[:60]!r}.") from None


KEYWORDS: Final = frozenset(
    b"v vt vn vp f l p o g s mg mtllib usemtl usemap maplib cstype deg bmat step curv curv2 surf "
    b"parm trim hole scrv sp end con bevel c_interp d_interp lod shadow_obj trace_obj ctech "
    b"stech call csh".split()
)
"""First words of lines that the format knows."""

_MOST_COMMENTS: Final = 20
_malformed_obj: Final = partial(
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
    positions, sizes, corners = array("d"), array("q"), array("q")
    others: dict[str, None] = {}
    comments: list[bytes] = []
    for lines in line_blocks(data):
        for line in lines:
            words = line.split()
            if not words:
                continue
            if words[0] == b"v":
                positions.extend(_point(words[1:4], _malformed_obj))
            elif words[0] == b"f":
                corners += _corners(words[1:], len(positions) // 3)
                sizes.append(len(words) - 1)
            elif words[0].startswith(b"#"):
                comments += [line] * (len(comments) < _MOST_COMMENTS)
            elif words[0] in KEYWORDS:
                others[words[0].decode()] = None
            else:
                raise _malformed_obj(f"The OBJ file has a line {line[:40]!r}.")
        limits.require("vertices", len(positions) // 3)
        limits.require("faces", len(sizes))
    if not positions:
        raise _malformed_obj("The OBJ file contains no vertex.")
    polygons = triangulate_sizes(sizes, corners, limits)
    return Frame(
        np.array(positions).reshape(-1, 3),
        polygons.faces,
        notes=polygons.notes,
        ignored=tuple(others),
        statements=space_in(b"".join(comments)),
    )


def _corners(words: list[bytes], n_vertices: int) -> array[int]:
    try:
        numbers = [int(word.partition(b"/")[0]) for word in words]
        # Counted from one; from the last vertex so far where negative.
        corners = array("q", [n - 1 if n > 0 else n_vertices + n for n in numbers])
    except (ValueError, OverflowError):
        raise _malformed_obj(f"A face of the OBJ file reads {b' '.join(words)[:40]!r}.") from None
    if numbers and (min(corners) < 0 or 0 in numbers):
        raise _malformed_obj(
            f"A face of the OBJ file names vertex {min(numbers)}, but {n_vertices} are before "
            "it and counting starts at 1."
        )
    return corners


# ST, C, N say what follows x, y and z on a line; forms with 4 or n coordinates are not read.
_KEYWORD: Final = re.compile(rb"(?:ST)?C?N?OFF(?=\s|$)")
_malformed_off: Final = partial(
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
        raise _malformed_off("The file does not begin with 'OFF'.")
    counts = first[keyword.end() :].split() or next(lines, b"").split()
    try:
        n_vertices, n_faces = (int(word) for word in counts[:2])
    except ValueError:
        raise _malformed_off(f"The OFF file has the counts {b' '.join(counts)[:40]!r}.") from None
    if n_vertices < 0 or n_faces < 0:
        raise _malformed_off("The OFF file has a negative count.")
    limits.require("vertices", n_vertices)
    limits.require("faces", n_faces)
    positions = array("d")
    for line in islice(lines, n_vertices):
        positions.extend(_point(line.split()[:3], _malformed_off))
    if len(positions) != 3 * n_vertices:
        raise _malformed_off(
            f"The OFF file declares {n_vertices} vertices but ends after {len(positions) // 3}."
        )
    sizes, corners = array("q"), array("q")
    for line in islice(lines, n_faces):
        words = line.split()
        try:
            size = int(words[0])
            polygon = array("q", map(int, words[1 : max(size, 0) + 1]))
        except (ValueError, OverflowError):
            size, polygon = -1, array("q")
        if len(polygon) != size:
            raise _malformed_off(f"Polygon {len(sizes)} of the OFF file reads {line[:40]!r}.")
        sizes.append(size)
        corners += polygon
    if len(sizes) != n_faces or next(lines, None) is not None:
        more = "fewer" if len(sizes) != n_faces else "more"
        raise _malformed_off(
            f"The OFF file declares {n_vertices} vertices and {n_faces} polygons, but {more} "
            "lines follow."
        )
    polygons = triangulate_sizes(sizes, corners, limits)
    vertices = np.array(positions).reshape(-1, 3)
    return Frame(vertices, polygons.faces, notes=polygons.notes, statements=space_in(data[:1024]))


def _without_comments(data: bytes) -> Iterator[bytes]:
    for line in lines_of(data):
        if stripped := line.partition(b"#")[0].strip():
            yield stripped
