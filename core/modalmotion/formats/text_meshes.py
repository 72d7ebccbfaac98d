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
from collections.abc import Iterator
from functools import partial
from itertools import islice
from typing import Final

import numpy as np
from numpy.typing import NDArray

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


def parse_points(rows: list[list[bytes]]) -> NDArray[np.float64]:
    """Turn rows of three words into positions.

    Parameters
    ----------
    rows : list of list of bytes

    Returns
    -------
    (rows, 3) float64

    Raises
    ------
    ValueError
        If a row is not three numbers.
    """
    for row in rows:
        if len(row) != 3:
            raise ValueError(f"{len(row)} coordinates in place of three")
    return np.array([float(word) for row in rows for word in row]).reshape(-1, 3)


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
        raise _malformed_obj("The OBJ file contains no vertex.")
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
                raise _malformed_obj(f"The OBJ file has a line {line[:40]!r}.")
            if words[0] not in (b"v", b"f"):
                others[words[0]] = None


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


def _positions(rows: list[list[bytes]]) -> NDArray[np.float64]:
    try:
        return parse_points(rows)
    except ValueError as error:
        raise _malformed_obj(
            f"A vertex of the OBJ file is not a point ({str(error)[:60]})."
        ) from error


# ST, C, N say what follows x, y and z on a line; forms with 4 or n coordinates are not read.
_KEYWORD: Final = re.compile(rb"(?:ST)?C?N?OFF(?=\s|$)")
_BLOCK_ROWS: Final = 30_000
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
            raise _malformed_off(f"Polygon {len(sizes)} of the OFF file reads {line[:40]!r}.")
        sizes.append(size)
        corners += polygon
    if len(sizes) != n_faces or next(lines, None) is not None:
        more = "fewer" if len(sizes) != n_faces else "more"
        raise _malformed_off(
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
            raise _malformed_off(
                f"A vertex of the OFF file is not a point ({str(error)[:60]})."
            ) from error
        if not rows:
            raise _malformed_off(
                f"The OFF file declares {n_vertices} vertices but ends after {n_read}."
            )
        blocks.append(block)
        n_read += len(rows)
    return np.concatenate(blocks) if blocks else np.zeros((0, 3))
