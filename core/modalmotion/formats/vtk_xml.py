"""Surfaces in VTK's XML: .vtp, and .vtu of polygons (VTK file formats, "XML file formats").

Arrays are text, base64, or bytes behind all elements; packed ones in blocks. Only points, polygons,
the time and the coordinate system are read; other arrays are named.
"""

import re
import struct
from binascii import a2b_base64
from collections.abc import Callable, Iterator
from typing import Final
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from modalmotion.errors import LimitError, MalformedFileError
from modalmotion.formats.frame import Frame, misread, space_in
from modalmotion.formats.vtk_legacy import malformed, numbers_in, surface_of, whole
from modalmotion.limits import NO_LIMITS, ReadLimits
from modalmotion.numeric.unpacking import unpacked
from modalmotion.representation import Array, Bytes, Ints

_KINDS: Final = {
    f"{name}{8 * n}": f"{letter}{n}"
    for name, letter in (("Int", "i"), ("UInt", "u"), ("Float", "f"))
    for n in (1, 2, 4, 8)
    if letter + str(n) != "f1"
} | {"String": "u1"}
_WORDS: Final = {"UInt32": "I", "UInt64": "Q"}
_TYPES: Final = ("PolyData", "UnstructuredGrid")
_CELLS: Final = ("Verts", "Lines", "Strips", "Polys")
_APPENDED: Final = re.compile(rb"<AppendedData([^<>]*)>\s*_")

# A surface with fifty arrays of data has two hundred elements.
_MOST_ELEMENTS: Final = 1_000
_DEEPEST: Final = 20


def read_vtk_xml(data: bytes, limits: ReadLimits = NO_LIMITS) -> Frame:
    """Read one .vtp or .vtu file.

    Parameters
    ----------
    data : bytes
    limits : ReadLimits, optional

    Raises
    ------
    MalformedFileError
        If it is not readable, or an array has other numbers than the file declares.
    LimitError
        If it declares more than `limits` accept.
    """
    # What is appended is no XML.
    found = _APPENDED.search(data)
    tree = data
    if found is not None:
        tree = data[: found.start()] + b"</VTKFile>"
        if not data.rstrip().endswith(b"</VTKFile>"):
            raise malformed("The VTK file is cut short.")
    root = xml_tree(tree, "VTK", malformed, _MOST_ELEMENTS)
    with misread(malformed, "The VTK file is not as VTK writes it"):
        return _File(root, data, found, limits).frame()


class _File:
    """The elements of a file, and its bytes."""

    def __init__(
        self, root: Element, data: bytes, found: re.Match[bytes] | None, limits: ReadLimits
    ) -> None:
        self.root, self.data, self.limits = root, data, limits
        self.start = len(data) if found is None else found.end()
        self.is_raw = found is not None and b"base64" not in found[1]
        # What arrays unpack to, together, and what of the file was read for them.
        self.of_file, self.n_bytes, self.n_read = limits.of_file(len(data)), 0, 0
        self.order = {"LittleEndian": "<", "BigEndian": ">"}[root.get("byte_order", "LittleEndian")]
        self.word = _WORDS[root.get("header_type", "UInt32")]
        self.packing = root.get("compressor", "")

    def frame(self) -> Frame:
        """Join the pieces of the surface."""
        kind = self.root.get("type", "")
        content = self.root.find(kind) if kind in _TYPES else None
        if content is None:
            raise malformed(f"The VTK file is of the type {kind[:40]!r}, not a surface.")
        is_grid = kind == "UnstructuredGrid"
        pieces = content.findall("Piece")
        sizes = [_count(piece, "NumberOfPoints") for piece in pieces]
        self.limits.require(vertices=sum(sizes))
        name = "NumberOfCells" if is_grid else "NumberOfPolys"
        self.limits.require(faces=sum(_count(piece, name) for piece in pieces))
        points, cells, types, n_points = [], [], [], 0
        for piece, n in zip(pieces, sizes, strict=True):
            if n:
                points.append(self._values(_named(piece.find("Points"), ""), 3 * n).reshape(n, 3))
            n_cells = _count(piece, name)
            offsets, corners = self._cells(piece.find("Cells" if is_grid else "Polys"), n_cells)
            if len(corners) and not 0 <= corners.min() <= corners.max() < n:
                raise malformed(
                    f"A polygon of the VTK file names vertex {corners.max()} or {corners.min()} of "
                    f"{n} in its piece."
                )
            cells.append((np.diff(offsets), corners + n_points))
            if is_grid and n_cells:
                types.append(self._values(_named(piece.find("Cells"), "types"), n_cells))
            n_points += n
        if not n_points:
            raise malformed("The VTK file contains no points.")
        counts = {name: sum(_count(p, f"NumberOf{name}") for p in pieces) for name in _CELLS}
        data = [
            f"{kind.lower()}.{array.get('Name', '')}"
            for kind in ("Point", "Cell")
            for array in pieces[0].iterfind(f"{kind}Data/*")
        ]
        return surface_of(
            np.concatenate(points),
            np.concatenate([sizes for sizes, _ in cells]),
            np.concatenate([corners for _, corners in cells]),
            np.concatenate(types) if types else None,
            self.limits,
            ignored=data,
            counts=counts,
            statements=dict(self._statements(content.find("FieldData"))),
        )

    def _statements(self, field: Element | None) -> Iterator[tuple[str, str]]:
        for array in [] if field is None else field:
            if array.get("Name") == "TimeValue":
                times = self._values(array, None)
                if len(times) == 1:
                    yield "time", repr(float(times[0]))
            elif array.get("Name") == "SPACE":
                text = self._values(array, None).astype(np.uint8).tobytes()
                yield from space_in(b"SPACE=" + text)

    def _cells(self, cells: Element | None, n: int) -> tuple[Ints, Ints]:
        if not n:
            return np.zeros(1, dtype=np.int64), np.zeros(0, dtype=np.int64)
        ends = whole(self._values(_named(cells, "offsets"), n))
        offsets = np.concatenate([[0], ends])
        corners = whole(self._values(_named(cells, "connectivity"), int(ends[-1])))
        return offsets, corners

    def _values(self, array: Element, n: int | None) -> Array:
        """Read an array of so many numbers; of any number if that is None."""
        kind = np.dtype(self.order + _KINDS[array.get("type", "")])
        form, text = array.get("format", "ascii"), (array.text or "").strip()
        if n is not None:
            # Text of a number is two bytes or more.
            self._hold(n * kind.itemsize)
        if form == "ascii":
            values = numbers_in(text.encode(), kind.newbyteorder("="))
        elif form == "appended":
            start = self.start + _count(array, "offset")
            values = np.frombuffer(self._bytes(self.data, start, self.is_raw), kind)
        else:
            values = np.frombuffer(self._bytes(text.encode("ascii"), 0, False), kind)
        if n is not None and len(values) != n:
            raise malformed(
                f"The array {array.get('Name', '')[:40]!r} of the VTK file contains {len(values)} "
                f"numbers in place of {n}."
            )
        return values.astype(kind.newbyteorder("="), copy=False)

    def _bytes(self, data: bytes, at: int, is_raw: bool) -> bytes | Bytes:
        """Read what a head declares: a number of bytes, or blocks and their packed sizes."""

        def read(n_bytes: int) -> bytes:
            nonlocal at
            width = n_bytes if is_raw else 4 * -(-n_bytes // 3)
            piece = data[at : at + width]
            found = piece if is_raw else a2b_base64(piece)[:n_bytes]
            if len(found) < n_bytes:
                raise malformed(f"An array of the VTK file has {len(found)} bytes of {n_bytes}.")
            at += width
            # Heads are read twice; many arrays at one place would take minutes.
            self.n_read += width
            if self.n_read > 2 * len(self.data):
                raise malformed("The arrays of the VTK file are on one another.")
            return found

        start, size = at, struct.calcsize(self.word)
        if not self.packing:
            (n_bytes,) = struct.unpack(self.order + self.word, read(size))
            at = start
            return read(size + n_bytes)[size:]
        n_blocks, block, last = struct.unpack(f"{self.order}3{self.word}", read(3 * size))
        at = start
        heads = read((3 + n_blocks) * size)[3 * size :]
        lengths = [block] * max(0, n_blocks - bool(last)) + [last] * bool(last)
        packed = struct.unpack(f"{self.order}{n_blocks}{self.word}", heads)
        self._hold(sum(lengths))
        pieces = read(sum(packed))
        ends = np.cumsum([0, *packed]).tolist()
        if self.packing != "vtkZLibDataCompressor":
            raise MalformedFileError(
                f"The VTK file is compressed by {self.packing[:40]!r}, which is not read.",
                remedy="Save it again with the compressor ZLib, or without compression.",
            )
        pairs = zip(ends, ends[1:], lengths, strict=False)
        return b"".join(unpacked(pieces[a:b], "zlib", n).tobytes() for a, b, n in pairs)

    def _hold(self, n_bytes: int) -> None:
        self.n_bytes += n_bytes
        self.of_file.require(decompressed_bytes=self.n_bytes)


def _named(parent: Element | None, name: str) -> Element:
    for array in [] if parent is None else parent:
        if name in ("", array.get("Name")):
            return array
    raise malformed(f"The VTK file has no array {name or 'of points'!r}.")


def _count(element: Element, name: str) -> int:
    text = element.get(name, "0").strip()
    if not (text.isascii() and text.isdigit() and len(text) <= 18):
        raise malformed(f"The VTK file states {name} as {text[:20]!r}.")
    return int(text)


def xml_tree(
    data: bytes,
    form: str,
    malformed: Callable[[str], MalformedFileError],
    most: int,
    *,
    has_type: bool = False,
) -> Element:
    """Parse XML that has no entities, nor a document type unless such files have it.

    Parameters
    ----------
    data : bytes
    form : str
        Name of the form, in messages.
    malformed : callable
        Makes the error.
    most : int
        Elements.
    has_type : bool
        Whether such files have a document type.

    Raises
    ------
    MalformedFileError
        Made by `malformed`, with the form in its message.
    LimitError
        If it has more elements, or more in one another than 20.
    """
    builder = TreeBuilder()
    n_elements = depth = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal n_elements, depth
        n_elements, depth = n_elements + 1, depth + 1
        for limit, value, at_most in (
            ("xml_elements", n_elements, most),
            ("xml_depth", depth, _DEEPEST),
        ):
            if value > at_most:
                raise LimitError(
                    f"The {form} file has more than {at_most} elements"
                    f"{' in one another' if limit == 'xml_depth' else ''}.",
                    remedy="Save the surface alone, without its arrays of data.",
                    limit=limit,
                    details={"most": at_most},
                )
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(*_: object) -> None:
        raise malformed(f"The {form} file contains a document type or entities.")

    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.EntityDeclHandler = refuse
    if not has_type:
        parser.StartDoctypeDeclHandler = refuse
    bad = (expat.ExpatError, LookupError, ValueError)
    with misread(malformed, f"The {form} file is not readable XML", bad):
        parser.Parse(data, True)
    return builder.close()
