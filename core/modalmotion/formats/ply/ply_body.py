"""Elements of a PLY file, after its header."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError
from modalmotion.formats.text import lines_of

_malformed: Final = partial(
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
            raise _malformed(f"The PLY element {element.name!r} has no properties.")
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
        raise _malformed(
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
                raise _malformed(
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
        raise _malformed(f"A list of the PLY element {element.name!r} has {size} items.")
    return size


def _too_few(element: Element, n_read: int) -> MalformedFileError:
    return _malformed(
        f"The PLY file declares {element.count} rows of {element.name!r} but ends after "
        f"{n_read} of them."
    )
