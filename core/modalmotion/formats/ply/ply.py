"""PLY, text and binary: elements with properties, as its header declares them.

The reader uses "x", "y", "z" of the element "vertex" and the list "vertex_indices" (or
"vertex_index") of "face"; everything else is skipped and named. Texture files are never opened.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError
from modalmotion.formats.frames.frame import Frame, space_in
from modalmotion.formats.ply.ply_body import Element, Property, read_elements
from modalmotion.formats.polygons import triangulate_sizes
from modalmotion.limits import NO_LIMITS, ReadLimits
from modalmotion.mesh.checks import FloatArray

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
