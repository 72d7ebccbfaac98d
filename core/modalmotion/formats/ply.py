"""PLY, text and binary: elements with properties, as its header declares them.

The reader uses "x", "y", "z" of the element "vertex" and the list "vertex_indices" (or
"vertex_index") of "face"; everything else is skipped and named. Texture files are never opened.
Text is read as binary numbers of eight bytes: the two forms differ in nothing else.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError
from modalmotion.formats.frame import Frame, space_in, triangulate_sizes
from modalmotion.formats.text_meshes import lines_of
from modalmotion.limits import NO_LIMITS, ReadLimits
from modalmotion.mesh.checks import FloatArray

_malformed_body: Final = partial(
    MalformedFileError, remedy="The file may be cut short: send it again, or export it anew."
)
_STRUCT_CODES: Final = {
    "i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d",
}  # fmt: skip
_NUMBER_BYTES: Final = 8


class Property(NamedTuple):
    """A number, or a list if it has a type for its length; types are NumPy's, without order."""

    name: str
    item_type: str
    count_type: str | None


@dataclass(frozen=True)
class Element:
    """Rows of the same properties."""

    name: str
    count: int
    properties: tuple[Property, ...]

    @property
    def has_lists(self) -> bool:
        """Whether rows may differ in length."""
        return any(p.count_type is not None for p in self.properties)

    def too_few(self, n_read: int) -> MalformedFileError:
        """Make the error for rows that are missing."""
        return _malformed_body(
            f"The PLY file declares {self.count} rows of {self.name!r} but ends after {n_read} of "
            "them."
        )


class Rows(NamedTuple):
    """Rows of an element: numbers by property, sizes and items of lists, bytes of each row."""

    columns: dict[str, NDArray[Any]]
    lists: dict[str, tuple[NDArray[np.int64], NDArray[np.int64]]]
    widths: NDArray[np.int64]


def read_elements(
    data: bytes, start: int, elements: tuple[Element, ...], order: str | None
) -> dict[str, Rows]:
    """Read all elements, by their names.

    Parameters
    ----------
    data : bytes
    start : int
        Where the header ends.
    elements : tuple of Element
    order : {"<", ">"} or None
        Byte order; None for text.

    Raises
    ------
    MalformedFileError
        If the rows differ, in number or form, from the header's declaration.
    """
    body, lines, line = memoryview(data), array("q"), 0
    if order is None:
        body, lines = _numbers_in(body[start:])
        start = 0
    found = {}
    for element in elements:
        if element.count and not element.properties:
            raise _malformed_body(f"The PLY element {element.name!r} has no properties.")
        plain = element
        if order is None:
            plain = Element(
                element.name,
                element.count,
                tuple(Property(p.name, "f8", p.count_type and "f8") for p in element.properties),
            )
        rows = _rows(body, start, plain, order or "<")
        start += int(rows.widths.sum())
        if order is None:
            # A line is a row: else a number left out would move all that follow.
            widths = _NUMBER_BYTES * np.array(lines[line : line + element.count], dtype=np.int64)
            wrong = np.flatnonzero(widths != rows.widths[: len(widths)])
            if wrong.size:
                raise _malformed_body(
                    f"Row {wrong[0]} of the PLY element {element.name!r} has "
                    f"{widths[wrong[0]] // _NUMBER_BYTES} numbers."
                )
            line += element.count
        found[element.name] = _typed(rows, element)
    if bytes(body[start : start + 1000]).strip() or line < len(lines):
        raise _malformed_body(
            "The PLY file contains more than its header declares "
            f"({[(e.name, e.count) for e in elements][:8]})."
        )
    return found


def _numbers_in(text: memoryview) -> tuple[memoryview, array[int]]:
    """Read all words as numbers, with the number of words of each line that has any."""
    numbers, counts = array("d"), array("q")
    for line in lines_of(text):
        words = line.split()
        counts.append(len(words))
        try:
            numbers.extend(map(float, words))
        except ValueError:
            raise _malformed_body(f"A row of the PLY file reads {line[:60]!r}.") from None
    return memoryview(numbers.tobytes()), counts


def _typed(rows: Rows, element: Element) -> Rows:
    """Numbers in the precision that the header states, text too; lists of whole numbers."""
    types = {p.name: p.item_type for p in element.properties}
    with np.errstate(over="ignore"):
        columns = {
            name: values.astype("f4" if types[name] == "f4" else "f8")
            for name, values in rows.columns.items()
        }
    lists = {}
    for name, of in rows.lists.items():
        # Only lists of integers can name vertices.
        if types[name][0] != "f":
            with np.errstate(invalid="ignore"):
                sizes, items = (values.astype(np.int64) for values in of)
            if (items != of[1]).any():
                raise _malformed_body(f"A list of the PLY element {element.name!r} has fractions.")
            lists[name] = sizes, items
    return Rows(columns, lists, rows.widths)


def _rows(body: memoryview, start: int, element: Element, order: str) -> Rows:
    # Rows all as long as the first, as in most files, are read in one piece.
    dtype = _row_type(body, start, element, order)
    table = np.zeros(0, dtype)
    if element.count and start + dtype.itemsize * element.count <= len(body):
        table = np.frombuffer(body, dtype, element.count, start)
    numbered = list(enumerate(element.properties))
    counts = [f"{i}n" for i, p in numbered if p.count_type is not None]
    if len(table) == element.count and all((table[n] == table[n][:1]).all() for n in counts):
        return Rows(
            {p.name: table[f"{i}"] for i, p in numbered if p.count_type is None},
            {p.name: (table[f"{i}n"], table[f"{i}"].ravel()) for i, p in numbered if p.count_type},
            np.full(element.count, dtype.itemsize),
        )
    if not element.has_lists:
        raise element.too_few((len(body) - start) // max(dtype.itemsize, 1))
    return _walk(body, start, element, order)


def _row_type(body: memoryview, at: int, element: Element, order: str) -> np.dtype[Any]:
    fields: list[Any] = []
    for i, p in enumerate(element.properties):
        if p.count_type is None:
            fields.append((f"{i}", order + p.item_type))
            at += int(p.item_type[1])
            continue
        size = _size(body, at, order, p, element, 0) if element.count else 0
        at += int(p.count_type[1]) + size * int(p.item_type[1])
        fields += [(f"{i}n", order + p.count_type), (f"{i}", order + p.item_type, (size,))]
    return np.dtype(fields)


def _walk(body: memoryview, start: int, element: Element, order: str) -> Rows:
    """Read lists of any length, row by row; numbers beside them are skipped."""
    names = [p.name for p in element.properties if p.count_type]
    sizes, items = ({name: array("d") for name in names} for _ in range(2))
    ends, at = array("q", [start]), start
    for row in range(element.count):
        for p in element.properties:
            if p.count_type is None:
                at += int(p.item_type[1])
                continue
            size = _size(body, at, order, p, element, row)
            at += int(p.count_type[1])
            sizes[p.name].append(size)
            code = f"{order}{size}{_STRUCT_CODES[p.item_type]}"
            items[p.name].extend(struct.unpack_from(code, body, at))
            at += size * int(p.item_type[1])
        if at > len(body):
            raise element.too_few(row)
        ends.append(at)
    lists: Any = {name: (np.array(sizes[name]), np.array(items[name])) for name in names}
    return Rows({}, lists, np.diff(ends))


def _size(body: memoryview, at: int, order: str, p: Property, element: Element, row: int) -> int:
    """Length of a list that the bytes contain whole."""
    n_bytes = int((p.count_type or "0")[1:] or 0)
    if at + n_bytes > len(body):
        raise element.too_few(row)
    size = struct.unpack_from(f"{order}{_STRUCT_CODES[p.count_type or '']}", body, at)[0]
    if not size >= 0 or size != size // 1:
        raise _malformed_body(f"A list of the PLY element {element.name!r} has {size} items.")
    if size > (len(body) - at - n_bytes) // int(p.item_type[1]):
        raise element.too_few(row)
    return int(size)


_TYPES: Final = {
    f"{'u' * (sign == 'u')}{name}": f"{sign}{n}"
    for n, names in ((1, ("char", "int8")), (2, ("short", "int16")), (4, ("int", "int32")))
    for name in names
    for sign in "iu"
} | {"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"}
_ORDERS: Final = {b"ascii": None, b"binary_little_endian": "<", b"binary_big_endian": ">"}
_LISTS: Final = ("vertex_indices", "vertex_index")
_LONGEST_HEADER: Final = 1 << 16
_malformed: Final = partial(
    MalformedFileError, remedy="Export the frame again as PLY, with 'vertex' and 'face' elements."
)

# A comment of our own files: "comment modalmotion unit mm".
_OURS: Final = b"comment modalmotion "


def read_ply(data: bytes, limits: ReadLimits = NO_LIMITS) -> Frame:
    """Read one PLY file.

    Parameters
    ----------
    data : bytes
    limits : ReadLimits, optional

    Returns
    -------
    Frame
        float32 where the file contains "float" in binary, else float64.

    Raises
    ------
    MalformedFileError
        If the bytes are not a PLY file, or fewer or more than its header declares.
    LimitError
        If it declares more than `limits` accept.
    """
    header = _read_header(data)
    by_name = {element.name: element for element in header.elements}
    if len(by_name) != len(header.elements) or "vertex" not in by_name:
        raise _malformed(f"The PLY file has the elements {list(by_name)[:8]}.")
    limits.require("vertices", by_name["vertex"].count)
    if "face" in by_name:
        limits.require("faces", by_name["face"].count)
    if sum(element.count for element in header.elements) > 2 * len(data):
        raise _malformed(
            f"The PLY file declares {[(e.name, e.count) for e in header.elements][:8]}, more "
            f"than its {len(data)} bytes can contain."
        )
    rows = read_elements(data, header.body, header.elements, header.order)
    columns, faces = rows["vertex"].columns, rows["face"].lists if "face" in rows else {}
    if not {*"xyz"} <= columns.keys():
        raise _malformed(
            "The PLY file's vertices have no x, y and z, or lists of varying length beside them."
        )
    xyz = [columns[axis] for axis in "xyz"]
    is_single = all(a.dtype == np.float32 for a in xyz)
    stacked: NDArray[Any] = np.stack(xyz, axis=1)
    positions: FloatArray = stacked if is_single else stacked.astype(np.float64)
    name = next((name for name in _LISTS if name in faces), None)
    if name is None and "face" in by_name and by_name["face"].count:
        raise _malformed("The PLY file's faces have no vertex_indices.")
    polygons = triangulate_sizes(*(((), ()) if name is None else faces[name]))
    used = {*(("vertex", axis) for axis in "xyz"), ("face", name)}
    return Frame(
        positions,
        polygons.faces,
        notes=polygons.notes,
        ignored=tuple(
            f"{e.name}.{p.name}"
            for e in header.elements
            for p in e.properties
            if (e.name, p.name) not in used
        ),
        statements=header.statements,
    )


def write_ply(
    positions: FloatArray,
    faces: NDArray[np.int64],
    statements: Mapping[str, str],
    of_vertices: Mapping[str, NDArray[np.float64]] = MappingProxyType({}),
) -> bytes:
    """Write one mesh as binary little-endian PLY.

    Parameters
    ----------
    positions : (vertices, 3) float32 or float64
    faces : (faces, 3) int64
    statements : mapping of str to str
        Written as comments, which a reader returns as `Frame.statements`.
    of_vertices : mapping of str to (vertices,) float64
        Further properties, by name.

    Returns
    -------
    bytes
    """
    kind = "float" if positions.dtype == np.float32 else "double"
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment modalmotion {name} {value}" for name, value in statements.items()),
        f"element vertex {len(positions)}",
        *(f"property {kind} {name}" for name in ("x", "y", "z", *of_vertices)),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    table = np.zeros(len(faces), dtype=[("n", "u1"), ("corners", "<i4", 3)])
    table["n"], table["corners"] = 3, faces
    rows = np.column_stack([positions, *of_vertices.values()]) if of_vertices else positions
    little = rows.astype(positions.dtype.newbyteorder("<"), copy=False)
    return "\n".join(lines).encode() + little.tobytes() + table.tobytes()


class _Header(NamedTuple):
    order: str | None
    elements: tuple[Element, ...]
    statements: tuple[tuple[str, str], ...]
    body: int


def _read_header(data: bytes) -> _Header:
    head = data[:_LONGEST_HEADER]
    end = head.find(b"end_header")
    newline = head.find(b"\n", end)
    if not head.startswith(b"ply") or end < 0 or newline < 0:
        raise _malformed(f"These {len(data)} bytes have no PLY header (the file may be cut short).")
    orders: list[str | None] = []
    elements: list[Element] = []
    statements = list(space_in(head[:end]))
    for line in head[:end].splitlines()[1:]:
        words = line.split()
        try:
            if not words or words[0] in (b"comment", b"obj_info"):
                if line.startswith(_OURS):
                    name, _, value = line[len(_OURS) :].decode().strip().partition(" ")
                    statements.append((name, value))
            elif words[0] == b"format":
                orders.append(_ORDERS[words[1]])
            elif words[0] == b"element" and words[2].isdigit():
                elements.append(Element(words[1].decode(), int(words[2]), ()))
            else:
                elements[-1] = _with_property(elements[-1], [word.decode() for word in words])
        except (KeyError, IndexError, ValueError):
            raise _malformed(f"The PLY header has a line {line[:60]!r}.") from None
    if not orders:
        raise _malformed("The PLY header states no format.")
    return _Header(orders[-1], tuple(elements), tuple(statements), newline + 1)


def _with_property(element: Element, words: list[str]) -> Element:
    keyword, *kinds, name = words
    count = _TYPES[kinds[1]] if kinds[0] == "list" else None
    added = Property(name, _TYPES[kinds[-1]], count)
    names = [p.name for p in element.properties]
    if keyword != "property" or name in names or count in ("f4", "f8"):
        raise ValueError(name)
    return Element(element.name, element.count, (*element.properties, added))
