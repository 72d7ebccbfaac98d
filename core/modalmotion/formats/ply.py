"""PLY, text and binary: elements with properties, as its header declares them.

The reader uses "x", "y", "z" of the element "vertex" and the list "vertex_indices" (or
"vertex_index") of "face"; everything else is skipped and named. Texture files are never opened.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from types import MappingProxyType
from typing import Any, Final

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
_BLOCK_ROWS: Final = 30_000
_STRUCT_CODES: Final = {
    "i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d",
}  # fmt: skip

Arrays = dict[str, "array[int]"]
Key = tuple[str, str]
Columns = dict[Key, NDArray[Any]]
Lists = dict[Key, tuple[NDArray[np.int64], NDArray[np.int64]]]


@dataclass(frozen=True)
class Property:
    """A number, or a list if it has a type for its length.

    Parameters
    ----------
    name : str
    item_type : str
        NumPy's code of the number or of the list's numbers, without byte order.
    count_type : str or None
        NumPy's code of the list's length.
    """

    name: str
    item_type: str
    count_type: str | None


@dataclass(frozen=True)
class Element:
    """Rows of the same properties."""

    name: str
    count: int
    properties: tuple[Property, ...]

    def with_property(self, added: Property) -> Element:
        """Return the element with one more property."""
        if added.name in [p.name for p in self.properties] or added.count_type in ("f4", "f8"):
            raise ValueError(added.name)
        return replace(self, properties=(*self.properties, added))

    @property
    def has_lists(self) -> bool:
        """Whether rows may differ in length."""
        return any(p.count_type is not None for p in self.properties)


def read_elements(
    data: bytes, start: int, elements: tuple[Element, ...], order: str | None
) -> tuple[Columns, Lists]:
    """Read all elements.

    Parameters
    ----------
    data : bytes
    start : int
        Where the header ends.
    elements : tuple of Element
    order : {"<", ">"} or None
        Byte order; None for text.

    Returns
    -------
    columns : dict of (element, property) to (count,) ndarray
        Numbers, in the type that the header states.
    lists : dict of (element, property) to (sizes, items), int64
        Lists of integers, one after the other.

    Raises
    ------
    MalformedFileError
        If the rows differ, in number or form, from the header's declaration.
    """
    columns: Columns = {}
    lists: Lists = {}
    for element in elements:
        if element.count and not element.properties:
            raise _malformed_body(f"The PLY element {element.name!r} has no properties.")
    if order is None:
        lines = lines_of(memoryview(data)[start:])
        for element in elements:
            _read_text(lines, element, columns, lists)
        rest = next(lines, b"")
    else:
        for element in elements:
            start = _read_binary(data, start, element, order, columns, lists)
        rest = data[start : start + 1000].strip()
    if rest:
        raise _malformed_body(
            "The PLY file contains more than its header declares "
            f"({[(e.name, e.count) for e in elements][:8]})."
        )
    return columns, lists


def _read_text(lines: Iterator[bytes], element: Element, columns: Columns, lists: Lists) -> None:
    scalars = [p for p in element.properties if p.count_type is None]
    sizes, items = _empty_lists(element)
    blocks = []
    for start in range(0, element.count, _BLOCK_ROWS):
        n_rows = min(_BLOCK_ROWS, element.count - start)
        numbers: list[float] = []
        n_read = 0
        for line in islice(lines, n_rows):
            try:
                _read_row(line.split(), element, numbers, sizes, items)
            except (ValueError, IndexError, OverflowError):
                raise _malformed_body(
                    f"Row {start + n_read} of the PLY element {element.name!r} reads {line[:60]!r}."
                ) from None
            n_read += 1
        if n_read != n_rows:
            raise _too_few(element, start + n_read)
        blocks.append(np.array(numbers).reshape(n_rows, len(scalars)))
    table = np.concatenate(blocks) if blocks else np.zeros((0, len(scalars)))
    for column, p in enumerate(scalars):
        values = table[:, column]
        if p.item_type == "f4":
            # The header's type is the file's precision, in text as in binary.
            with np.errstate(over="ignore"):
                values = values.astype(np.float32)
        columns[element.name, p.name] = values
    _keep_lists(element, sizes, items, lists)


def _read_row(
    words: list[bytes], element: Element, numbers: list[float], sizes: Arrays, items: Arrays
) -> None:
    at = 0
    for p in element.properties:
        if p.count_type is None:
            numbers.append(float(words[at]))
            at += 1
            continue
        size = int(words[at])
        row = words[at + 1 : at + 1 + max(size, 0)]
        if len(row) != size:
            raise ValueError(size)
        if p.name in sizes:
            sizes[p.name].append(size)
            items[p.name].extend(map(int, row))
        at += 1 + size
    if at != len(words):
        raise ValueError(at)


def _read_binary(
    data: bytes, start: int, element: Element, order: str, columns: Columns, lists: Lists
) -> int:
    if element.count == 0:
        for p in element.properties:
            columns[element.name, p.name] = np.zeros(0, p.item_type)
            lists[element.name, p.name] = (np.zeros(0, np.int64), np.zeros(0, np.int64))
        return start
    # Rows all as long as the first, as in most files, are read in one piece.
    dtype = _row_type(data, start, element, order)
    n_bytes = dtype.itemsize * element.count
    if start + n_bytes <= len(data):
        table = np.frombuffer(data, dtype, element.count, start)
        counts = [f"{i}n" for i, p in enumerate(element.properties) if p.count_type is not None]
        if all((table[name] == table[name][0]).all() for name in counts):
            for i, p in enumerate(element.properties):
                values = table[f"{i}"].astype(p.item_type)
                if p.count_type is None:
                    columns[element.name, p.name] = values
                elif p.item_type[0] != "f":
                    sizes = table[f"{i}n"].astype(np.int64)
                    lists[element.name, p.name] = (sizes, values.astype(np.int64).ravel())
            return start + n_bytes
    if not element.has_lists:
        raise _too_few(element, (len(data) - start) // max(dtype.itemsize, 1))
    return _walk(data, start, element, order, lists)


def _row_type(data: bytes, start: int, element: Element, order: str) -> np.dtype[Any]:
    fields: list[Any] = []
    at = start
    for i, p in enumerate(element.properties):
        if p.count_type is None:
            fields.append((f"{i}", order + p.item_type))
            at += int(p.item_type[1])
            continue
        size = _unpack(data, at, order, p.count_type, element)
        at += int(p.count_type[1]) + size * int(p.item_type[1])
        if at > len(data):
            raise _too_few(element, 0)
        fields += [(f"{i}n", order + p.count_type), (f"{i}", order + p.item_type, (size,))]
    return np.dtype(fields)


def _walk(data: bytes, start: int, element: Element, order: str, lists: Lists) -> int:
    sizes, items = _empty_lists(element)
    at = start
    for row in range(element.count):
        for p in element.properties:
            width = int(p.item_type[1])
            if p.count_type is None:
                at += width
                continue
            size = _unpack(data, at, order, p.count_type, element)
            at += int(p.count_type[1])
            if at + size * width > len(data):
                raise _too_few(element, row)
            if p.name in sizes:
                sizes[p.name].append(size)
                code = f"{order}{size}{_STRUCT_CODES[p.item_type]}"
                items[p.name].extend(struct.unpack_from(code, data, at))
            at += size * width
    if at > len(data):
        raise _too_few(element, element.count - 1)
    _keep_lists(element, sizes, items, lists)
    return at


def _empty_lists(element: Element) -> tuple[Arrays, Arrays]:
    # Only lists of integers can name vertices.
    names = [p.name for p in element.properties if p.count_type and p.item_type[0] != "f"]
    return {name: array("q") for name in names}, {name: array("q") for name in names}


def _keep_lists(element: Element, sizes: Arrays, items: Arrays, lists: Lists) -> None:
    for name in sizes:
        lists[element.name, name] = (
            np.array(sizes[name], dtype=np.int64),
            np.array(items[name], dtype=np.int64),
        )


def _unpack(data: bytes, at: int, order: str, count_type: str, element: Element) -> int:
    if at + int(count_type[1]) > len(data):
        raise _too_few(element, 0)
    size: int = struct.unpack_from(order + _STRUCT_CODES[count_type], data, at)[0]
    if size < 0:
        raise _malformed_body(f"A list of the PLY element {element.name!r} has {size} items.")
    return size


def _too_few(element: Element, n_read: int) -> MalformedFileError:
    return _malformed_body(
        f"The PLY file declares {element.count} rows of {element.name!r} but ends after "
        f"{n_read} of them."
    )


_TYPES: Final = {
    name: code
    for code, names in {
        "i1": "char int8",
        "u1": "uchar uint8",
        "i2": "short int16",
        "u2": "ushort uint16",
        "i4": "int int32",
        "u4": "uint uint32",
        "f4": "float float32",
        "f8": "double float64",
    }.items()
    for name in names.split()
}
_ORDERS: Final = {
    b"ascii": None,
    b"binary_little_endian": "<",
    b"binary_big_endian": ">",
}
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
    columns, lists = read_elements(data, header.body, header.elements, header.order)
    if not all(("vertex", axis) in columns for axis in "xyz"):
        raise _malformed(
            "The PLY file's vertices have no x, y and z, or lists of varying length beside them."
        )
    xyz: list[NDArray[Any]] = [columns["vertex", axis] for axis in "xyz"]
    is_single = all(a.dtype == np.float32 for a in xyz)
    positions = np.stack(xyz, axis=1)
    name = next((name for name in _LISTS if ("face", name) in lists), None)
    if name is None and "face" in by_name and by_name["face"].count:
        raise _malformed("The PLY file's faces have no vertex_indices.")
    none = np.zeros(0, dtype=np.int64)
    sizes, corners = (none, none) if name is None else lists["face", name]
    polygons = triangulate_sizes(sizes, corners)
    used = {("vertex", axis) for axis in "xyz"} | {("face", name)}
    return Frame(
        positions.astype(np.float32) if is_single else positions.astype(np.float64),
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


@dataclass(frozen=True)
class _Header:
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
            elif words[0] == b"element":
                elements.append(_element(words))
            else:
                elements[-1] = elements[-1].with_property(_property(words))
        except (KeyError, IndexError, ValueError):
            raise _malformed(f"The PLY header has a line {line[:60]!r}.") from None
    if not orders:
        raise _malformed("The PLY header states no format.")
    return _Header(orders[-1], tuple(elements), tuple(statements), newline + 1)


def _element(words: list[bytes]) -> Element:
    count = int(words[2])
    if count < 0:
        raise ValueError(count)
    return Element(words[1].decode(), count, ())


def _property(words: list[bytes]) -> Property:
    keyword, *rest = (word.decode() for word in words)
    if keyword != "property":
        raise ValueError(keyword)
    if rest[0] == "list":
        return Property(rest[3], _TYPES[rest[2]], _TYPES[rest[1]])
    return Property(rest[1], _TYPES[rest[0]], None)
