"""Surfaces in legacy .vtk files: PolyData, or an unstructured grid of polygons, to version 5.1.

Words are in any case, on any line; numbers are text or big-endian. What follows POINT_DATA or
CELL_DATA is not read.
"""

import re
from collections.abc import Iterable, Mapping
from functools import partial
from math import prod
from typing import Any, Final

import numpy as np

from modalmotion.errors import MalformedFileError
from modalmotion.formats.frame import Frame, space_in, triangulate
from modalmotion.limits import NO_LIMITS, ReadLimits
from modalmotion.representation import Array, Ints

malformed: Final = partial(
    MalformedFileError, remedy="Save the frame again as a polygonal surface (vtkPolyData)."
)
"""Error for a VTK file that cannot be read."""

# Cells of an unstructured grid, by VTK's numbers: vertices and lines are left out as of a surface.
_POLYGONS: Final = (5, 7, 9)
_NO_FACES: Final = (1, 2, 3, 4)

_BYTES: Final = dict(zip(("char", "short", "int", "long"), (1, 2, 4, 8), strict=True))
_KINDS: Final = {
    **{f"{u}{name}": f"{u[:1] or 'i'}{n}" for u in ("", "unsigned_") for name, n in _BYTES.items()},
    **{f"vtktype{u}int{8 * n}": f"{u or 'i'}{n}" for u in ("", "u") for n in (1, 2, 4, 8)},
    **dict(zip(("float", "double", "vtkidtype"), ("f4", "f8", "i4"), strict=True)),
}
_LEFT_OUT: Final = {"vertices": "Verts", "lines": "Lines"}
_SECTIONS: Final = {
    **dict.fromkeys(("polygons", "cells"), "Polys"),
    **_LEFT_OUT,
    "triangle_strips": "Strips",
}
_WORD: Final = re.compile(rb"\s*(\S{1,250})(?=\s|$)")
_OFFSETS: Final = re.compile(rb"(?i)\s+offsets(?=\s)")
# In text all up to the next word are numbers; nan and inf are numbers.
_NO_NUMBER: Final = re.compile(rb"(?<=\s)(?!(?i:nan|inf)\b)[A-Za-z_]")


def read_vtk_legacy(data: bytes, limits: ReadLimits = NO_LIMITS) -> Frame:
    """Read one legacy .vtk file.

    Parameters
    ----------
    data : bytes
    limits : ReadLimits, optional

    Raises
    ------
    MalformedFileError
        If it is not readable, or has fewer numbers than it declares.
    LimitError
        If it declares more than `limits` accept.
    """
    lines = data[:2048].split(b"\n", 2)
    title = lines[1] if len(lines) > 2 else b""
    file = _Legacy(data, len(lines[0]) + len(title) + 2)
    file.is_binary = file.word() == "binary"
    dataset, kind = file.word(), file.word()
    if dataset != "dataset" or kind not in ("polydata", "unstructured_grid"):
        raise malformed(f"The VTK file is a {kind[:40] or 'file'} without a surface.")
    points: Array = np.zeros((0, 3))
    cells = {"Polys": (np.zeros(0, np.int64),) * 2}
    types, statements = None, dict(space_in(title))
    while (word := file.word()) not in ("", "point_data", "cell_data"):
        if word == "points":
            n = file.count()
            limits.require(vertices=n)
            points = file.numbers(3 * n, file.word()).reshape(n, 3)
        elif word in _SECTIONS:
            n, m = file.count(), file.count()
            limits.require(faces=n)
            cells[_SECTIONS[word]] = file.cells(n, m)
        elif word == "cell_types":
            types = file.numbers(file.count(), "int")
        elif word == "metadata":
            file.skip_metadata()
        elif word == "field":
            statements |= file.field()
        else:
            raise malformed(f"The VTK file has a section {word[:40]!r}, which is unknown.")
    if not len(points):
        raise malformed("The VTK file contains no points.")
    sizes, corners = cells["Polys"]
    if kind == "unstructured_grid" and len(sizes) != (0 if types is None else len(types)):
        raise malformed("The VTK file's grid has other types than cells.")
    counts = {name: len(of) for name, (of, _) in cells.items()}
    return surface_of(
        points,
        sizes,
        corners,
        types,
        limits,
        ignored=[word] * bool(word),
        counts=counts,
        statements=statements,
    )


def surface_of(
    points: Array,
    sizes: Ints,
    corners: Ints,
    types: Array | None,
    limits: ReadLimits,
    *,
    ignored: Iterable[str],
    counts: Mapping[str, int],
    statements: Mapping[str, str],
) -> Frame:
    """Make a frame of VTK's points and polygons.

    Parameters
    ----------
    points : (vertices, 3) float
    sizes : (polygons,) int64
    corners : (corners,) int64
    types : (polygons,) int or None
        Of the cells of a grid: lines and vertices among them are left out.
    limits : ReadLimits
    ignored : iterable of str
    counts : mapping of str to int
        Of "Verts", "Lines" and "Strips".
    statements : mapping of str to str

    Raises
    ------
    MalformedFileError
        If it has strips or cells of a volume, or sizes and corners do not fit.
    LimitError
        If its polygons are more triangles than `limits` accept.
    """
    skipped = [word for word, name in _LEFT_OUT.items() if counts.get(name)]
    if counts.get("Strips"):
        raise MalformedFileError(
            "The VTK file contains triangle strips.",
            remedy="Apply the filter 'Triangulate' and save again.",
        )
    if (sizes < 0).any() or sizes.sum() != len(corners):
        raise malformed("The VTK file's polygons do not add up to its list of corners.")
    if types is not None:
        are_faces = np.isin(types, _POLYGONS)
        if not (are_faces | np.isin(types, _NO_FACES)).all():
            raise MalformedFileError(
                "The VTK file's grid has cells that are no polygons.",
                remedy="Apply the filter 'Extract Surface' and save again.",
            )
        corners, sizes = corners[np.repeat(are_faces, sizes)], sizes[are_faces]
        skipped = [] if are_faces.all() else ["vertices or lines"]
    polygons = triangulate(sizes, corners, limits)
    return Frame(
        points if points.dtype == np.float32 else points.astype(np.float64),
        polygons.faces,
        notes=polygons.notes,
        ignored=(*ignored, *skipped),
        statements=tuple(statements.items()),
    )


def numbers_in(text: bytes, kind: np.dtype[Any]) -> Array:
    """Read numbers between spaces.

    Raises
    ------
    MalformedFileError
        If a word is no number, or a whole number is beyond its type.
    """
    # NumPy reads one number in spaces alone.
    text = text.strip()
    try:
        values: Array = np.fromstring(text, "f8" if kind.kind == "f" else "i8", sep=" ")
    except ValueError:
        raise malformed(f"Numbers of the VTK file read {text[:40]!r}.") from None
    with np.errstate(over="ignore"):
        cast = values.astype(kind)
    if kind.kind != "f" and (cast != values).any():
        raise malformed(f"A number of the VTK file is beyond its type, {kind}.")
    return cast


def whole(values: Array) -> Ints:
    """Give offsets or corners as int64.

    Raises
    ------
    MalformedFileError
        If the file declares them as fractions.
    """
    if values.dtype.kind == "f":
        raise malformed(f"The VTK file's polygons are numbers of the type {values.dtype}.")
    return values.astype(np.int64)


class _Legacy:
    """A place in a file, and what is read from there on."""

    def __init__(self, data: bytes, at: int) -> None:
        self.data, self.at, self.is_binary = data, at, False

    def word(self) -> str:
        """Next word, in small letters; empty at the end."""
        found = _WORD.match(self.data, self.at)
        if found is None:
            if self.data[self.at :].strip():
                raise malformed("The VTK file contains a word of more than 250 letters.")
            return ""
        self.at = found.end()
        return found[1].decode("latin-1").lower()

    def count(self) -> int:
        """Next word as a size."""
        word = self.word()
        if not (word.isascii() and word.isdigit() and len(word) <= 18):
            raise malformed(f"The VTK file declares the size {word[:20]!r}.")
        return int(word)

    def numbers(self, n: int, kind: str) -> Array:
        """So many numbers of a type."""
        if kind not in _KINDS:
            raise malformed(f"The VTK file contains numbers of the type {kind[:40]!r}.")
        dtype = np.dtype(_KINDS[kind])
        if not self.is_binary:
            found = _NO_NUMBER.search(self.data, self.at)
            start, self.at = self.at, len(self.data) if found is None else found.start()
            values = numbers_in(self.data[start : self.at], dtype)
        else:
            start = self._next_line()
            self.at = start + n * dtype.itemsize
            if self.at > len(self.data):
                raise malformed(f"The VTK file declares {n} numbers, and ends before.")
            values = np.frombuffer(self.data[start : self.at], dtype.newbyteorder(">"))
        if len(values) != n:
            raise malformed(f"The VTK file declares {n} numbers, and {len(values)} follow.")
        return values.astype(dtype, copy=False)

    def cells(self, n: int, m: int) -> tuple[Ints, Ints]:
        """Sizes of cells and their corners, as of version 5.1 or as lists before."""
        if (found := _OFFSETS.match(self.data, self.at)) is not None:
            self.at = found.end()
            offsets = whole(self.numbers(n, self.word()))
            if self.word() != "connectivity":
                raise malformed("The VTK file has no corners of its cells.")
            corners = whole(self.numbers(m, self.word()))
            if n and (offsets[0], offsets[-1]) != (0, m):
                raise malformed("The VTK file's polygons do not add up to its list of corners.")
            return np.diff(offsets), corners
        numbers = self.numbers(m, "int").astype(np.int64)
        if len(numbers) == 4 * n and (numbers[::4] == 3).all():
            return np.full(n, 3), numbers.reshape(-1, 4)[:, 1:].ravel()
        listed, place = numbers.tolist(), 0
        places: list[int] = []
        while place < m and len(places) < n and 0 <= listed[place] < m - place:
            places.append(place)
            place += 1 + listed[place]
        if place != m or len(places) != n:
            raise malformed("The VTK file's polygons do not add up to its list of corners.")
        return numbers[places], np.delete(numbers, places)

    def skip_metadata(self) -> None:
        """Go behind the empty line after a block of metadata."""
        end = re.compile(rb"\n[ \t]*\r?\n").search(self.data, self.at)
        self.at = len(self.data) if end is None else end.end()

    def field(self) -> dict[str, str]:
        """Read the time and the coordinate system from the arrays of a field."""
        self.word()
        found = dict[str, str]()
        for _ in range(self.count()):
            name = self.word()
            if name == "metadata":
                self.skip_metadata()
                name = self.word()
            n, kind = prod((self.count(), self.count())), self.word()
            if kind in ("string", "utf8_string"):
                self.at = self._next_line()
                texts = [self._text() for _ in range(n)]
                text = b" ".join(texts) if name == "space" else b""
                found |= dict(space_in(b"SPACE=" + text))
                continue
            values = self.numbers(n, kind)
            if name == "timevalue" and n == 1:
                found["time"] = repr(float(values[0]))
        return found

    def _text(self) -> bytes:
        """Text up to the end of the line; in binary behind its length, of 1 to 8 bytes."""
        start, end = self.at, self.data.find(b"\n", self.at)
        if self.is_binary and start < len(self.data):
            width = (8, 4, 2, 1)[self.data[start] >> 6]
            length = int.from_bytes(self.data[start : start + width], "big")
            start += width
            end = start + (length & (1 << 8 * width - 2) - 1)
        self.at = end + (not self.is_binary)
        if not start < self.at <= len(self.data):
            raise malformed("The VTK file is cut short.")
        return self.data[start:end]

    def _next_line(self) -> int:
        end = self.data.find(b"\n", self.at)
        if end < 0:
            raise malformed("The VTK file is cut short.")
        return end + 1
