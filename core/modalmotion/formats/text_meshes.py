"""Meshes as STL, OBJ and OFF, and numbers in lines of text, read in bounded memory.

Binary STL: 80 bytes of header, the number of triangles (uint32), then 50 bytes each: normal and
three corners (float32), two arbitrary bytes; all little-endian. Normals and the two bytes are not
used. STL has no vertices: each triangle has three of its own.

Of OBJ the lines "v x y z" and "f a b c ..." are read, all others skipped. Corners may read a, a/b,
a//c or a/b/c; only the vertex a counts, so texture seams and normals neither split nor reorder
vertices. Material files, textures, and the commands `call` and `csh` are never followed.

OFF is counts, then one vertex a line, then one polygon a line. Colours and normals after a vertex
or a polygon are not used.
"""

import io
import re
from array import array
from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError
from modalmotion.formats.frame import Frame, space_in, triangulate
from modalmotion.limits import NO_LIMITS, ReadLimits
from modalmotion.mesh.triangles import face_normals, oriented_faces
from modalmotion.representation import FloatArray, Floats, Ints

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


_TRIANGLE: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
_HEADER_BYTES: Final = 84
_malformed_stl: Final = partial(MalformedFileError, remedy="Export the frame again, as binary STL.")

# A facet of the text form; its normal is not used.
_FACET: Final = re.compile(
    rb"\s*facet\s+normal\s+\S+\s+\S+\s+\S+\s+outer\s+loop"
    + 3 * rb"\s+vertex\s+(\S+)\s+(\S+)\s+(\S+)"
    + rb"\s+endloop\s+endfacet(?!\S)"
)
# The name of a solid may contain any words.
_NAME_LINE: Final = re.compile(rb"(?m)^[ \t]*((?:end)?solid(?!\S)[^\r\n]*)")
# A facet that a block of lines cuts is no longer than this.
_LONGEST_FACET: Final = 10_000


def is_binary_stl(data: bytes) -> bool:
    """Return whether the number of triangles agrees with the number of bytes."""
    n = int.from_bytes(data[80:_HEADER_BYTES], "little")
    return len(data) >= _HEADER_BYTES and len(data) == _HEADER_BYTES + n * _TRIANGLE.itemsize


def read_stl(data: bytes, limits: ReadLimits = NO_LIMITS) -> Frame:
    """Read one STL file: three vertices of its own for each triangle.

    Parameters
    ----------
    data : bytes
    limits : ReadLimits, optional

    Returns
    -------
    Frame
        float32 from binary files, float64 from text.

    Raises
    ------
    MalformedFileError
        If the bytes are not an STL file, or fewer or more than it declares.
    LimitError
        If it holds more triangles than `limits` accept.
    """
    corners: FloatArray
    if is_binary_stl(data):
        triangles = np.frombuffer(data, _TRIANGLE, offset=_HEADER_BYTES)
        limits.require(faces=len(triangles))
        corners, header = triangles["corners"].reshape(-1, 3).astype(np.float32), data[:80]
    elif data[:1024].lstrip()[:5].lower() == b"solid":
        corners, header = _text_stl(data, limits), data[:1024].lstrip().partition(b"\n")[0]
    else:
        raise _malformed_stl(f"These {len(data)} bytes are not a complete STL file.")
    if not len(corners):
        raise _malformed_stl("The STL file contains no triangle.")
    faces = np.arange(len(corners), dtype=np.int64).reshape(-1, 3)
    return Frame(corners, faces, is_soup=True, statements=space_in(header))


def _text_stl(data: bytes, limits: ReadLimits) -> Floats:
    numbers, rest, is_open = array("d"), b"", False
    for lines in line_blocks(data):
        # Facets and, in every second place, lines that begin or end a solid.
        for i, piece in enumerate(_NAME_LINE.split(b"".join(lines).lower())):
            if i % 2:
                is_wrong = rest.strip() or piece.startswith(b"solid") == is_open
                is_open = not is_open
            else:
                rest += piece
                at = 0
                while (found := _FACET.match(rest, at)) is not None:
                    at = found.end()
                    try:
                        numbers.extend(map(float, found.groups()))
                    except ValueError:
                        raise _damaged(len(numbers) // 9, found[0]) from None
                rest = rest[at:].lstrip()
                is_wrong = (at and not is_open) or len(rest) > _LONGEST_FACET
            if is_wrong:
                raise _damaged(len(numbers) // 9, rest or piece)
        limits.require(faces=len(numbers) // 9)
    if rest or is_open:
        raise _malformed_stl(f"The STL file ends within facet {len(numbers) // 9}: {rest[:60]!r}.")
    return np.array(numbers).reshape(-1, 3)


def _damaged(facet: int, text: bytes) -> MalformedFileError:
    words = b" ".join(text.split())[:60].decode("ascii", "replace")
    return _malformed_stl(f"Facet {facet} of the STL file reads {words!r}.")


def write_stl(vertices: NDArray[np.floating], faces: Ints, title: str = "") -> bytes:
    """Write triangles as binary STL, in float32, all wound the same way round where they can be.

    Parameters
    ----------
    vertices : (vertices, 3) float
    faces : (faces, 3) int64
    title : str
        Of the header, in ASCII; at most 68 letters of it are kept.

    Returns
    -------
    bytes
        `read_stl` reads it back.
    """
    wound = oriented_faces(faces, len(vertices))
    corners = np.asarray(vertices, dtype=np.float64)
    wound = faces if wound is None else wound
    normals = face_normals(corners, wound)
    sizes = np.linalg.norm(normals, axis=1, keepdims=True)
    triangles = np.zeros(len(wound), _TRIANGLE)
    triangles["normal"] = np.divide(normals, sizes, out=np.zeros_like(normals), where=sizes > 0)
    triangles["corners"] = corners[wound]
    # A header that begins with "solid" would be text.
    header = f"modalmotion {title}".encode("ascii", "replace")[:80].ljust(80)
    return header + len(wound).to_bytes(4, "little") + triangles.tobytes()


KEYWORDS: Final = frozenset(
    b"v vt vn vp f l p o g s mg mtllib usemtl usemap maplib cstype deg bmat step curv curv2 surf "
    b"parm trim hole scrv sp end con bevel c_interp d_interp lod shadow_obj trace_obj ctech "
    b"stech call csh".split()
)
"""First words of lines that OBJ knows."""

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
        If a vertex or face cannot be read, or there is no vertex.
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
        limits.require(vertices=len(positions) // 3, faces=len(sizes))
    if not positions:
        raise _malformed_obj("The OBJ file contains no vertex.")
    polygons = triangulate(sizes, corners, limits)
    return Frame(
        np.array(positions).reshape(-1, 3),
        polygons.faces,
        notes=polygons.notes,
        ignored=tuple(others),
        statements=space_in(b"".join(comments)),
    )


def _corners(words: list[bytes], n_vertices: int) -> "array[int]":
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
OFF_KEYWORD: Final = re.compile(rb"(?:ST)?C?N?OFF(?=\s|$)")
"""First word of an OFF file."""

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
    plain = (line.partition(b"#")[0].strip() for line in lines_of(data))
    lines = filter(None, plain)
    first = next(lines, b"")
    keyword = OFF_KEYWORD.match(first)
    if keyword is None:
        raise _malformed_off("The file does not begin with 'OFF'.")
    counts = first[keyword.end() :].split() or next(lines, b"").split()
    if len(counts) < 2 or not all(word.isdigit() and len(word) <= 18 for word in counts[:2]):
        raise _malformed_off(f"The OFF file has the counts {b' '.join(counts)[:40]!r}.")
    n_vertices, n_faces = map(int, counts[:2])
    limits.require(vertices=n_vertices, faces=n_faces)
    positions, sizes, corners = array("d"), array("q"), array("q")
    for line in islice(lines, n_vertices):
        positions.extend(_point(line.split()[:3], _malformed_off))
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
    are_more = next(lines, None) is not None
    if (len(positions) // 3, len(sizes)) != (n_vertices, n_faces) or are_more:
        raise _malformed_off(
            f"The OFF file declares {n_vertices} vertices and {n_faces} polygons, but "
            f"{'more' if are_more else 'fewer'} lines follow."
        )
    polygons = triangulate(sizes, corners, limits)
    vertices = np.array(positions).reshape(-1, 3)
    return Frame(vertices, polygons.faces, notes=polygons.notes, statements=space_in(data[:1024]))
