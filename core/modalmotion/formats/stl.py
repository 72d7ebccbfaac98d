"""STL, binary and text: triangles without shared vertices.

Binary: 80 bytes of header, the number of triangles (uint32), then 50 bytes each: normal and
three corners (float32), two arbitrary bytes; all little-endian. Normals and the two bytes
are not used.
"""

from __future__ import annotations

import re
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError
from modalmotion.formats.frame import Frame, space_in
from modalmotion.formats.text_meshes import line_blocks
from modalmotion.limits import NO_LIMITS, ReadLimits
from modalmotion.mesh.checks import FloatArray
from modalmotion.mesh.triangles import face_normals, oriented_faces

_TRIANGLE: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
_HEADER_BYTES: Final = 84
# Largest ratio of declared to present bytes at which a file counts as cut short.
_LIKELY: Final = 100
_malformed: Final = partial(MalformedFileError, remedy="Export the frame again, as binary STL.")

# A facet of the text form, word by word; None is a number.
_FACET: Final = (
    *(b"facet", b"normal", None, None, None, b"outer", b"loop"),
    *(b"vertex", None, None, None) * 3,
    *(b"endloop", b"endfacet"),
)
_KEYWORDS: Final = tuple((i, word) for i, word in enumerate(_FACET) if word is not None)
_FIRST_CORNER: Final = 7
# The name of a solid may contain any words.
_NAME_LINE: Final = re.compile(rb"(?m)^[ \t]*((?:end)?solid(?!\S)[^\r\n]*)")


def is_binary_stl(data: bytes) -> bool:
    """Return whether the number of triangles agrees with the number of bytes."""
    return len(data) >= _HEADER_BYTES and _declared_bytes(data) == len(data)


def cut_short(data: bytes) -> int | None:
    """Size in bytes of a binary STL file that these may be the beginning of, else None.

    Its header is text or empty, and it declares more bytes than are present.
    """
    header = data[: _HEADER_BYTES - 4].rstrip(b"\x00 ")
    if len(data) <= _HEADER_BYTES or not all(32 <= byte < 127 for byte in header):
        return None
    declared = _declared_bytes(data)
    return declared if len(data) < declared <= _LIKELY * len(data) else None


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
        corners = _read_binary(data, limits)
        header = data[:80]
    elif data[:1024].lstrip()[:5].lower() == b"solid":
        corners = _read_text(data, limits)
        header = data[:1024].lstrip().partition(b"\n")[0]
    else:
        detail = ""
        if len(data) >= _HEADER_BYTES:
            n = int.from_bytes(data[80:_HEADER_BYTES], "little")
            detail = f" (a binary one of {n} triangles has {_declared_bytes(data)} bytes)"
        raise _malformed(f"These {len(data)} bytes are not a complete STL file{detail}.")
    if not len(corners):
        raise _malformed("The STL file contains no triangle.")
    faces = np.arange(len(corners), dtype=np.int64).reshape(-1, 3)
    return Frame(corners, faces, is_soup=True, statements=space_in(header))


def write_stl(vertices: NDArray[np.floating], faces: NDArray[np.int64], title: str = "") -> bytes:
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


def _declared_bytes(data: bytes) -> int:
    n = int.from_bytes(data[80:_HEADER_BYTES], "little")
    return _HEADER_BYTES + n * _TRIANGLE.itemsize


def _read_binary(data: bytes, limits: ReadLimits) -> NDArray[np.float32]:
    triangles = np.frombuffer(data, _TRIANGLE, offset=_HEADER_BYTES)
    limits.require("faces", len(triangles))
    return triangles["corners"].reshape(-1, 3).astype(np.float32)


def _read_text(data: bytes, limits: ReadLimits) -> NDArray[np.float64]:
    blocks: list[NDArray[np.float64]] = []
    words: list[bytes] = []
    n_facets = 0
    is_open = False
    for lines in line_blocks(data):
        # Facets and, in every second place, lines that begin or end a solid.
        for i, piece in enumerate(_NAME_LINE.split(b"".join(lines).lower())):
            if i % 2:
                begins = piece.startswith(b"solid")
                if words or begins == is_open:
                    raise _damaged(n_facets, b" ".join(words[:20]) or piece)
                is_open = begins
                continue
            words += piece.split()
            whole = len(words) // len(_FACET) * len(_FACET)
            if whole and not is_open:
                raise _damaged(n_facets, b" ".join(words[:20]))
            if whole:
                blocks.append(_facets(words[:whole], n_facets))
                del words[:whole]
                n_facets += whole // len(_FACET)
            limits.require("faces", n_facets)
    if words or is_open:
        raise _malformed(f"The STL file is cut short after {n_facets} whole facets.")
    return np.concatenate(blocks) if blocks else np.zeros((0, 3))


def _facets(words: list[bytes], n_before: int) -> NDArray[np.float64]:
    n = len(words) // len(_FACET)
    if any(words[i :: len(_FACET)].count(keyword) != n for i, keyword in _KEYWORDS):
        facets = [words[k * len(_FACET) : (k + 1) * len(_FACET)] for k in range(n)]
        bad = next(k for k in range(n) if any(facets[k][i] != word for i, word in _KEYWORDS))
        raise _damaged(n_before + bad, b" ".join(facets[bad]))
    corners = np.empty((n, 3, 3))
    try:
        for corner in range(3):
            for axis in range(3):
                place = _FIRST_CORNER + 4 * corner + 1 + axis
                corners[:, corner, axis] = list(map(float, words[place :: len(_FACET)]))
    except ValueError as error:
        raise _malformed(
            f"A vertex of the STL file is not a number ({str(error)[:60]})."
        ) from error
    return corners.reshape(-1, 3)


def _damaged(facet: int, text: bytes) -> MalformedFileError:
    return _malformed(
        f"Facet {facet} of the STL file reads {text[:60].decode('ascii', 'replace')!r}."
    )
