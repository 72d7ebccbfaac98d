"""PLY, text and binary: elements with properties, as its header declares them.

The reader uses "x", "y", "z" of the element "vertex" and the list "vertex_indices" (or
"vertex_index") of "face"; everything else is skipped and named. Texture files are never opened.
Text is read as binary numbers of eight bytes: the two forms differ in nothing else.
"""

import struct
from array import array
from collections.abc import Mapping
from functools import partial
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np

from modalmotion.errors import MalformedFileError
from modalmotion.formats.frame import Frame, space_in, triangulate
from modalmotion.formats.text_meshes import lines_of
from modalmotion.limits import NO_LIMITS, ReadLimits
from modalmotion.representation import Array, FloatArray, Floats, Ints

_malformed: Final = partial(
    MalformedFileError,
    remedy="Export the frame again as PLY, with 'vertex' and 'face' elements; the file may be cut "
    "short.",
)
_KINDS: Final = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
_CODES: Final = dict(zip(_KINDS, "bBhHiIfd", strict=True))
_TYPES: Final = {
    name: kind
    for names in (
        "char uchar short ushort int uint float double",
        "int8 uint8 int16 uint16 int32 uint32 float32 float64",
    )
    for name, kind in zip(names.split(), _KINDS, strict=True)
}
_ORDERS: Final = {b"ascii": None, b"binary_little_endian": "<", b"binary_big_endian": ">"}
_LISTS: Final = ("vertex_indices", "vertex_index")
_LONGEST_HEADER: Final = 1 << 16

# A comment of our own files: "comment modalmotion unit mm".
_OURS: Final = b"comment modalmotion "


class _Property(NamedTuple):
    """A number, or a list if it has a type for its length; types are NumPy's, without order."""

    name: str
    kind: str
    length: str | None


class _Element(NamedTuple):
    """Rows of the same properties."""

    name: str
    n_rows: int
    properties: tuple[_Property, ...]


class _Header(NamedTuple):
    order: str | None
    elements: tuple[_Element, ...]
    statements: tuple[tuple[str, str], ...]
    body: int


class _Rows(NamedTuple):
    """Numbers by property, sizes and items of lists, and bytes of each row."""

    columns: dict[str, Array]
    lists: dict[str, tuple[Array, Array]]
    widths: Ints


def read_ply(data: bytes, limits: ReadLimits = NO_LIMITS) -> Frame:
    """Read one PLY file.

    Parameters
    ----------
    data : bytes
    limits : ReadLimits, optional

    Returns
    -------
    Frame
        float32 where the file contains "float", else float64.

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
    n_faces = by_name["face"].n_rows if "face" in by_name else 0
    limits.require(vertices=by_name["vertex"].n_rows, faces=n_faces)
    declared = [(element.name, element.n_rows) for element in header.elements][:8]
    if sum(element.n_rows for element in header.elements) > 2 * len(data):
        raise _malformed(
            f"The PLY file declares {declared}, more than its {len(data)} bytes can contain."
        )
    body, widths, at = memoryview(data), array("q"), header.body
    if header.order is None:
        body, widths = _numbers_in(body[at:])
        at = 0
    rows = dict[str, _Rows]()
    for element in header.elements:
        rows[element.name], at = _rows(body, at, element, header.order)
    if header.order is None:
        # A line is a row: else a number left out would move all that follow.
        read = np.concatenate([own.widths for own in rows.values()])
        found = np.array(widths[: len(read)], dtype=np.int64)
        wrong = np.flatnonzero(read[: len(found)] != found)
        if wrong.size:
            raise _malformed(
                f"Row {wrong[0]} after the PLY header has {found[wrong[0]] // 8} numbers."
            )
    if bytes(body[at : at + 1000]).strip():
        raise _malformed(f"The PLY file contains more than its header declares ({declared}).")
    columns, faces = rows["vertex"].columns, rows["face"].lists if "face" in rows else {}
    if not {*"xyz"} <= columns.keys():
        raise _malformed(
            "The PLY file's vertices have no x, y and z, or lists of varying length beside them."
        )
    kinds = {p.name: p.kind for p in by_name["vertex"].properties}
    with np.errstate(over="ignore"):
        xyz = [columns[axis].astype("f4" if kinds[axis] == "f4" else "f8") for axis in "xyz"]
    listed = next((name for name in _LISTS if name in faces), None)
    if listed is None and n_faces:
        raise _malformed("The PLY file's faces have no vertex_indices.")
    sizes, corners = _whole(faces[listed]) if listed else (np.zeros(0, np.int64),) * 2
    polygons = triangulate(sizes, corners, limits)
    used = {*(("vertex", axis) for axis in "xyz"), ("face", listed)}
    every = [(e.name, p.name) for e in header.elements for p in e.properties]
    return Frame(
        np.stack(xyz, axis=1),
        polygons.faces,
        notes=polygons.notes,
        ignored=tuple(f"{one}.{of}" for one, of in every if (one, of) not in used),
        statements=header.statements,
    )


def _numbers_in(text: memoryview) -> "tuple[memoryview, array[int]]":
    """Read all words as numbers, with the bytes of each line that has any."""
    numbers, widths = array("d"), array("q")
    for line in lines_of(text):
        words = line.split()
        widths.append(8 * len(words))
        try:
            numbers.extend(map(float, words))
        except ValueError:
            raise _malformed(f"A row of the PLY file reads {line[:60]!r}.") from None
    return memoryview(numbers.tobytes()), widths


def _whole(of: tuple[Array, Array]) -> tuple[Ints, Ints]:
    with np.errstate(invalid="ignore"):
        sizes, items = (values.astype(np.int64) for values in of)
    if (items != of[1]).any():
        raise _malformed("The faces of the PLY file have fractions.")
    return sizes, items


def _rows(body: memoryview, start: int, element: _Element, order: str | None) -> tuple[_Rows, int]:
    """Read the rows of an element; where they end."""
    if element.n_rows and not element.properties:
        raise _malformed(f"The PLY element {element.name!r} has no properties.")
    # Of text all numbers are float64; only lists of integers can name vertices.
    named = [p.name for p in element.properties if p.length and p.kind[0] != "f"]
    if order is None:
        plain = tuple(_Property(p.name, "f8", p.length and "f8") for p in element.properties)
        element, order = element._replace(properties=plain), "<"
    # Rows all as long as the first, as in most files, are read in one piece.
    fields: list[Any] = []
    at = start
    for p in element.properties:
        size = _size(body, at, order, p, element, 0) if p.length and element.n_rows else 0
        if p.length:
            fields += [(f"{p.name} n", order + p.length), (p.name, order + p.kind, (size,))]
        else:
            fields.append((p.name, order + p.kind))
        at += int((p.length or p.kind)[1]) + size * int(p.kind[1])
    dtype, table = np.dtype(fields), np.zeros(0, fields)
    if element.n_rows and start + dtype.itemsize * element.n_rows <= len(body):
        table = np.frombuffer(body, dtype, element.n_rows, start)
    lists = [p.name for p in element.properties if p.length]
    if len(table) == element.n_rows and all(
        (table[f"{n} n"] == table[f"{n} n"][:1]).all() for n in lists
    ):
        columns = {p.name: table[p.name] for p in element.properties if not p.length}
        found: Any = {n: (table[f"{n} n"], table[n].ravel()) for n in named}
        return _Rows(columns, found, np.full(element.n_rows, dtype.itemsize)), start + table.nbytes
    if not lists:
        raise _too_few(element, (len(body) - start) // max(dtype.itemsize, 1))
    # Else row by row; numbers beside the lists are skipped.
    sizes, items = ({name: array("d") for name in lists} for _ in range(2))
    ends, at = array("q", [start]), start
    for row in range(element.n_rows):
        for p in element.properties:
            size = 1
            if p.length:
                size = _size(body, at, order, p, element, row)
                at += int(p.length[1])
                sizes[p.name].append(size)
                items[p.name].extend(struct.unpack_from(f"{order}{size}{_CODES[p.kind]}", body, at))
            at += size * int(p.kind[1])
        if at > len(body):
            raise _too_few(element, row)
        ends.append(at)
    found = {name: (np.array(sizes[name]), np.array(items[name])) for name in named}
    return _Rows({}, found, np.diff(ends)), at


def _size(body: memoryview, at: int, order: str, p: _Property, element: _Element, row: int) -> int:
    """Length of a list that the bytes contain whole."""
    code = order + _CODES[p.length or ""]
    left = len(body) - at - struct.calcsize(code)
    size = struct.unpack_from(code, body, at)[0] if left >= 0 else 0
    if not size >= 0 or size != size // 1:
        raise _malformed(f"A list of the PLY element {element.name!r} has {size} items.")
    if left < 0 or size > left // int(p.kind[1]):
        raise _too_few(element, row)
    return int(size)


def _too_few(element: _Element, n_read: int) -> MalformedFileError:
    return _malformed(
        f"The PLY file declares {element.n_rows} rows of {element.name!r} but ends after {n_read} "
        "of them."
    )


def _read_header(data: bytes) -> _Header:
    head = data[:_LONGEST_HEADER]
    end = head.find(b"end_header")
    newline = head.find(b"\n", end)
    if not head.startswith(b"ply") or end < 0 or newline < 0:
        raise _malformed(f"These {len(data)} bytes have no PLY header.")
    orders: list[str | None] = []
    elements: list[_Element] = []
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
                elements.append(_Element(words[1].decode(), int(words[2]), ()))
            else:
                elements[-1] = _with_property(elements[-1], [word.decode() for word in words])
        except (KeyError, IndexError, ValueError):
            raise _malformed(f"The PLY header has a line {line[:60]!r}.") from None
    if not orders:
        raise _malformed("The PLY header states no format.")
    return _Header(orders[-1], tuple(elements), tuple(statements), newline + 1)


def _with_property(element: _Element, words: list[str]) -> _Element:
    keyword, *kinds, name = words
    count = _TYPES[kinds[1]] if kinds[0] == "list" else None
    names = [p.name for p in element.properties]
    if keyword != "property" or name in names or count in ("f4", "f8"):
        raise ValueError(name)
    added = _Property(name, _TYPES[kinds[-1]], count)
    return element._replace(properties=(*element.properties, added))


def write_ply(
    positions: FloatArray,
    faces: Ints,
    statements: Mapping[str, str],
    of_vertices: Mapping[str, Floats] = MappingProxyType({}),
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
