"""XDMF: a mesh over time in XML, its numbers inline or in an HDF5 file beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import InputError, MalformedFileError, ShapeError
from modalmotion.formats.detect import Format
from modalmotion.formats.frame import Frame
from modalmotion.formats.frames import FrameStack
from modalmotion.formats.named_arrays import faces_in
from modalmotion.formats.result import Parser, Reading

XDMF_SUFFIXES: Final = (".xdmf", ".xmf")
"""Ends of the names of such files."""

_DISPLACEMENT: Final = ("displacement", "displacements", "u", "disp")
_MOST_ELEMENTS: Final = 200_000

_malformed: Final = partial(
    MalformedFileError,
    remedy="Save triangles over time from ParaView (Xdmf3), or VTKHDF; see docs/formats.",
)


@dataclass
class _Element:
    tag: str
    attributes: dict[str, str]
    text: str = ""
    inner: list[_Element] = field(default_factory=list)

    def all(self, tag: str) -> Iterator[_Element]:
        """Give the elements of that name below, itself included."""
        if self.tag == tag:
            yield self
        for one in self.inner:
            yield from one.all(tag)

    def child(self, tag: str) -> _Element | None:
        return next((one for one in self.inner if one.tag == tag), None)


def read_xdmf(data: bytes, beside: Callable[[str], bytes], parser: Parser) -> Reading:
    """Read a triangle mesh over time.

    Parameters
    ----------
    data : bytes
        The XML.
    beside : callable
        Gives the bytes of a file that it names, of its own folder or archive.
    parser : Parser
        Its limits apply.

    Raises
    ------
    MalformedFileError
        If it is not readable, or contains no triangles.
    InputError
        If the frames do not form a sequence.
    """
    domain = _parsed(data)
    grids = [g for g in domain.all("Grid") if g.attributes.get("GridType", "Uniform") == "Uniform"]
    if not grids:
        raise _malformed("The XDMF file contains no grid.")
    steps = [grid for grid in grids if grid.child("Time") is not None] or grids
    parser.limits.require("frames", len(steps))
    arrays = _Arrays(beside, parser)
    # A grid that repeats another's mesh (xi:include) has none of its own.
    shared = {tag: next(domain.all(tag), None) for tag in ("Topology", "Geometry")}
    stack: FrameStack | None = None
    times = []
    for number, grid in enumerate(steps):
        frame = _frame(grid, shared, arrays)
        if stack is None:
            stack = FrameStack(frame, Format.XDMF, len(steps), parser.limits)
        else:
            stack.add(number, frame, Format.XDMF)
        time = grid.child("Time")
        if time is not None:
            times.append(float(time.attributes.get("Value", "nan")))
    assert stack is not None  # noqa: S101 (there is a grid)
    return stack.result(tuple(times) if len(times) == len(steps) else None)


def _frame(grid: _Element, shared: dict[str, _Element | None], arrays: _Arrays) -> Frame:
    topology = grid.child("Topology") or shared["Topology"]
    geometry = grid.child("Geometry") or shared["Geometry"]
    if topology is None or geometry is None:
        raise _malformed("A grid of the XDMF file has no mesh.")
    kind = topology.attributes.get("TopologyType", topology.attributes.get("Type", ""))
    if kind.lower() != "triangle":
        raise _malformed(f"The cells of the XDMF file are {kind[:40]!r}, not 'Triangle'.")
    positions = arrays.of(geometry).reshape(-1, 3)
    faces, _ = faces_in(arrays.of(topology).reshape(-1, 3), -1)
    notes: tuple[str, ...] = ()
    others = [one for one in grid.inner if one.tag == "Attribute"]
    moved = [o for o in others if o.attributes.get("Name", "").lower() in _DISPLACEMENT]
    if moved:
        u = arrays.of(moved[0]).reshape(-1, 3)
        if u.shape != positions.shape:
            raise ShapeError(
                f"There are {len(u)} displacements of {len(positions)} vertices.",
                remedy="Save a displacement for each vertex.",
            )
        positions = positions + u
        name = moved[0].attributes["Name"]
        notes = (f"The displacement {name!r} was added to the vertices.",)
    if positions.dtype != np.float32:
        positions = positions.astype(np.float64)
    ignored = tuple(o.attributes.get("Name", "")[:40] for o in others if o not in moved[:1])
    return Frame(positions, faces, notes=notes, ignored=ignored)


class _Arrays:
    """Numbers of data items, each file read once."""

    def __init__(self, beside: Callable[[str], bytes], parser: Parser) -> None:
        self.beside, self.parser = beside, parser
        self.files: dict[str, dict[str, NDArray[Any]]] = {}

    def of(self, element: _Element) -> NDArray[Any]:
        item = element.child("DataItem")
        if item is None:
            raise _malformed(f"An element {element.tag!r} of the XDMF file has no numbers.")
        if item.attributes.get("Format", "XML").upper() == "XML":
            return np.array(item.text.split(), dtype=np.float64)
        name, _, place = item.text.strip().rpartition(":")
        if name not in self.files:
            self.files[name] = self.parser.parse("datasets", self.beside(name)).arrays
        if place.strip("/") not in self.files[name]:
            raise _malformed(f"{name[-60:]!r} contains no dataset {place[:60]!r}.")
        return self.files[name][place.strip("/")]


def _parsed(data: bytes) -> _Element:
    """Read the XML: no document types, no entities, no more elements than frames need."""
    root = _Element("", {})
    path, counted = [root], [0]

    def refuse(*_: object) -> None:
        raise _malformed("The XDMF file contains entities, which are never read.")

    def start(tag: str, attributes: dict[str, str]) -> None:
        counted[0] += 1
        if counted[0] > _MOST_ELEMENTS:
            raise _malformed(f"The XDMF file has more than {_MOST_ELEMENTS} elements.")
        element = _Element(tag, attributes)
        path[-1].inner.append(element)
        path.append(element)
        if len(path) > 20:
            raise _malformed("The XDMF file has elements more than 20 deep.")

    def text(part: str) -> None:
        path[-1].text += part

    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.EntityDeclHandler = refuse
    parser.StartElementHandler, parser.CharacterDataHandler = start, text
    parser.EndElementHandler = lambda _tag: path.pop()
    try:
        parser.Parse(data, True)
    except InputError:
        raise
    except (expat.ExpatError, LookupError, ValueError) as error:
        raise _malformed(f"The XDMF file is not readable XML ({str(error)[:80]}).") from error
    return root
