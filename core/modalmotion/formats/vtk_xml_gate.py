"""The gate before VTK's reader of .vtp files: sizes compared with the bytes that there are.

VTK allocates what a file declares before it reads, searches an element's
attributes one after the other, and expands entities. So the declarations are read first, by the
parser that VTK itself uses, in time that grows with the file as its bytes do.

A binary array of numbers is preceded by its number of bytes; a compressed one by the number of its
blocks, the size of each when unpacked and that of the last (VTK's file formats, XML).
"""

from __future__ import annotations

import binascii
import re
import struct
from contextlib import suppress
from functools import partial
from typing import Final
from xml.parsers import expat

from modalmotion.errors import LimitError, MalformedFileError
from modalmotion.limits import UNFOLDING, ReadLimits

_ITEM_BYTES: Final = {
    f"{kind}{bits}": bits // 8 for kind in ("Int", "UInt", "Float") for bits in (8, 16, 32, 64)
}


_malformed: Final = partial(
    MalformedFileError, remedy="Save the frame again as a polygonal surface (vtkPolyData)."
)

# A surface with fifty arrays of data has two hundred elements, four deep, with ten attributes.
_MOST_ELEMENTS: Final = 1_000
_DEEPEST: Final = 20
_MOST_ATTRIBUTES: Final = 50
# Of a tag, a comment or an instruction: a parser that is fed in pieces reads it anew with each.
_LONGEST_MARKUP: Final = 1 << 16
_LONG_TAG: Final = re.compile(rb"<[^<>]{%d}" % _LONGEST_MARKUP)

# Of .vtp and of .vtu.
_TYPES: Final = ("PolyData", "UnstructuredGrid")

_ENCODINGS: Final = ("utf-8", "us-ascii", "ascii", "iso-8859-1")


class _AppendedDataError(Exception):
    """What follows is not XML: VTK stops there too."""


def require_plain_xml(data: bytes, limits: ReadLimits) -> None:
    """Refuse a .vtp file that is costly or dangerous to read.

    Parameters
    ----------
    data : bytes
    limits : ReadLimits

    Raises
    ------
    MalformedFileError
        If it holds a document type, or its sizes are not numbers or more than its bytes can
        contain.
    LimitError
        If it declares more than `limits` accept, or has more elements or attributes than a surface.
    """
    head = data[:4].removeprefix(b"\xef\xbb\xbf")
    if head.startswith((b"\xfe\xff", b"\xff\xfe")) or b"\0" in head:
        raise _other_encoding("UTF-16")
    end = data.find(b"<AppendedData")
    if _LONG_TAG.search(data, 0, len(data) if end < 0 else end) is not None:
        raise _too_much("markup_bytes", f"a tag of more than {_LONGEST_MARKUP} bytes")
    parser = expat.ParserCreate()
    walk = _Walk(data, limits, parser)
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = _refuse
    parser.XmlDeclHandler = _require_encoding
    parser.StartElementHandler, parser.EndElementHandler = walk.start, walk.end
    parser.CommentHandler = _require_short
    parser.ProcessingInstructionHandler = lambda _, text: _require_short(text)
    try:
        parser.Parse(data, True)
        # VTK looks for it in comments too.
        if end >= 0:
            raise _malformed("The .vtp file's 'AppendedData' is no element.")
    except _AppendedDataError:
        walk.require_appended(end)
    except (expat.ExpatError, LookupError) as error:
        raise _malformed(f"The .vtp file is not readable XML ({str(error)[:80]}).") from error


class _Walk:
    """Counts what the elements of a .vtp file declare."""

    def __init__(self, data: bytes, limits: ReadLimits, parser: expat.XMLParserType) -> None:
        self.data, self.limits, self.parser = data, limits, parser
        # What arrays unpack to, together.
        self.of_file, self.n_bytes = limits.of_file(len(data)), 0
        self.most_values, self.n_values, self.n_elements = len(data), 0, 0
        # Of the numbers in heads: the order of their bytes, and their type.
        self.order, self.word, self.is_compressed = "<", "I", False
        self.appended: list[tuple[str, str, int, int]] = []
        self.appended_at, self.is_raw = -1, False
        self.path: list[str] = []
        self.n_points = self.n_cells = 0
        self.totals = {"vertices": 0, "faces": 0}

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.n_elements += 1
        if self.n_elements > _MOST_ELEMENTS:
            raise _too_much("xml_elements", f"more than {_MOST_ELEMENTS} elements")
        if len(self.path) >= _DEEPEST:
            raise _too_much("xml_depth", f"elements more than {_DEEPEST} deep")
        if len(attributes) > _MOST_ATTRIBUTES:
            raise _too_much("xml_attributes", f"{len(attributes)} attributes on one element")
        if not self.path:
            if tag != "VTKFile":
                raise _malformed(f"The .vtp file begins with {tag[:40]!r}, not 'VTKFile'.")
            if (kind := attributes.get("type", "")) not in _TYPES:
                raise _malformed(f"The .vtp file is of the type {kind[:40]!r}, not 'PolyData'.")
            if attributes.get("compressor", ""):
                self.most_values, self.is_compressed = UNFOLDING * len(self.data), True
            self.order = ">" if attributes.get("byte_order") == "BigEndian" else "<"
            self.word = "Q" if attributes.get("header_type") == "UInt64" else "I"
        elif tag == "AppendedData":
            self.is_raw = attributes.get("encoding") == "raw"
            self.appended_at = self.parser.CurrentByteIndex
            raise _AppendedDataError
        elif tag == "Piece":
            self._piece(attributes)
        elif tag.endswith("Array") or tag == "Array":
            self._array(attributes)
        self.path.append(tag)

    def end(self, _: str) -> None:
        self.path.pop()

    def _piece(self, attributes: dict[str, str]) -> None:
        self.n_points = _whole(attributes, "NumberOfPoints")
        polygons = sum(_whole(attributes, name) for name in ("NumberOfPolys", "NumberOfCells"))
        others = ("NumberOfVerts", "NumberOfLines", "NumberOfStrips")
        self.n_cells = polygons + sum(_whole(attributes, name) for name in others)
        for limit, n in (("vertices", self.n_points), ("faces", polygons)):
            self.totals[limit] += n
            self.limits.require(limit, self.totals[limit])
        self._hold("points and cells", 3 * self.n_points + self.n_cells)

    def _array(self, attributes: dict[str, str]) -> None:
        rows = _whole(attributes, "NumberOfTuples")
        if self.path[-1] in ("PointData", "Points"):
            rows = max(rows, self.n_points)
        elif "Piece" in self.path:
            rows = max(rows, self.n_cells)
        columns = _whole(attributes, "NumberOfComponents", 1)
        self._hold(
            f"the array {attributes.get('Name', '')[:40]!r}", max(rows, columns, rows * columns)
        )

        name, kind = attributes.get("Name", ""), attributes.get("type", "")
        # The corners of polygons are as many as the last offset says.
        n_values = 0 if name == "connectivity" else rows * columns
        if "offset" in attributes:
            self.appended.append((name, kind, n_values, _whole(attributes, "offset")))
        elif attributes.get("format") == "binary":
            at = self.data.find(b">", self.parser.CurrentByteIndex) + 1
            while self.data[at : at + 1].isspace():
                at += 1
            self._require_head(name, kind, n_values, at, is_raw=False)

    def require_appended(self, found: int) -> None:
        """Refuse arrays behind the elements whose heads declare too much.

        Parameters
        ----------
        found : int
            Where the bytes first name the element, as VTK looks for it.
        """
        if found != self.appended_at:
            raise _malformed("The .vtp file names 'AppendedData' outside of its element.")
        first = self.data.find(b"_", self.data.find(b">", found)) + 1
        for name, kind, n_values, offset in self.appended:
            self._require_head(name, kind, n_values, first + offset, is_raw=self.is_raw)

    def _require_head(self, name: str, kind: str, n_values: int, at: int, *, is_raw: bool) -> None:
        """Refuse an array whose head declares more than its file or its element can contain.

        Parameters
        ----------
        name, kind : str
            Of the array, and of its numbers.
        n_values : int
            That its element declares; 0 where it declares none.
        at : int
            First byte of the head.
        is_raw : bool
            Bytes as they are, and not in base64.
        """
        form = f"{self.order}{3 if self.is_compressed else 1}{self.word}"
        size, head = struct.calcsize(form), b""
        with suppress(binascii.Error):
            # Three bytes in four letters.
            head = (
                self.data[at : at + size]
                if is_raw
                else binascii.a2b_base64(self.data[at : at + 4 * -(-size // 3)])
            )
        if len(head) < size:
            raise _malformed(f"The array {name[:40]!r} of the .vtp file has no readable head.")
        words = struct.unpack_from(form, head)
        n_bytes, n_heads = words[0], 0
        if self.is_compressed:
            n_blocks, block, last = words
            n_bytes = max(0, n_blocks - bool(last)) * block + last
            # The head goes on with the packed size of each block.
            n_heads = n_blocks * size // 3
        # More than its element states, or than there is where nothing is packed.
        room = n_values * _ITEM_BYTES.get(kind, 0) or n_bytes
        if not self.is_compressed:
            room = min(room, len(self.data))
        if n_bytes > room or n_heads > len(self.data):
            raise _malformed(
                f"The array {name[:40]!r} of the .vtp file begins with {words}: {n_bytes} bytes, "
                f"more than its element or its file of {len(self.data)} bytes can contain."
            )
        self.n_bytes += n_bytes
        self.of_file.require("decompressed_bytes", self.n_bytes)

    def _hold(self, what: str, n_values: int) -> None:
        self.n_values += n_values
        if self.n_values > self.most_values:
            raise _malformed(
                f"The .vtp file declares {self.n_values} numbers up to {what}, more than its "
                f"{len(self.data)} bytes can contain."
            )


def _whole(attributes: dict[str, str], name: str, default: int = 0) -> int:
    text = attributes.get(name, str(default)).strip()
    if not (text.isascii() and text.isdigit() and len(text) <= 18):
        raise _malformed(f"The .vtp file states {name} as {text[:20]!r}.")
    return int(text)


def _refuse(*_: object) -> None:
    raise _malformed("The .vtp file contains a document type or entities, which are never read.")


def _require_encoding(_version: str, encoding: str | None, _standalone: int) -> None:
    if encoding is not None and encoding.lower() not in _ENCODINGS:
        raise _other_encoding(encoding[:40])


def _other_encoding(name: str) -> MalformedFileError:
    return _malformed(f"The .vtp file is written in {name}, not in UTF-8.")


def _require_short(text: str) -> None:
    if len(text) > _LONGEST_MARKUP:
        raise _too_much("markup_bytes", f"a comment of more than {_LONGEST_MARKUP} characters")


def _too_much(limit: str, what: str) -> LimitError:
    return LimitError(
        f"The VTK file contains {what}.",
        remedy="Save the surface alone, without its arrays of data.",
        limit=limit,
    )
