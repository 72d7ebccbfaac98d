"""XDMF: a mesh over time in XML, its numbers inline or in an HDF5 file beside it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import InputError, MalformedFileError, ShapeError
from modalmotion.formats.detect import Format
from modalmotion.formats.frame import Frame
from modalmotion.formats.frames import FrameStack
from modalmotion.formats.named_arrays import faces_in
from modalmotion.formats.result import Parser, Reading
from modalmotion.formats.xml_trees import xml_tree

XDMF_SUFFIXES: Final = (".xdmf", ".xmf")
"""Ends of the names of such files."""

_DISPLACEMENT: Final = ("displacement", "displacements", "u", "disp")
_MOST_ELEMENTS: Final = 200_000

_malformed: Final = partial(
    MalformedFileError,
    remedy="Save triangles over time from ParaView (Xdmf3), or VTKHDF; see docs/formats.",
)


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
    domain = xml_tree(data, "XDMF", _malformed, _MOST_ELEMENTS, has_type=True)
    grids = [g for g in domain.iter("Grid") if g.get("GridType", "Uniform") == "Uniform"]
    if not grids:
        raise _malformed("The XDMF file contains no grid.")
    steps = [grid for grid in grids if grid.find("Time") is not None] or grids
    parser.limits.require("frames", len(steps))
    numbers = _numbers_of(beside, parser)
    stack: FrameStack | None = None
    times = []
    for number, grid in enumerate(steps):
        time = grid.find("Time")
        try:
            frame = _frame(grid, domain, numbers)
            times += [] if time is None else [float(time.get("Value", "nan"))]
        except InputError:
            raise
        except (TypeError, ValueError) as error:
            raise _malformed(
                f"Frame {number} of the XDMF file has numbers that cannot be read "
                f"({str(error)[:60]}).",
                frame=number,
            ) from error
        if stack is None:
            stack = FrameStack(frame, Format.XDMF, len(steps), parser.limits)
        else:
            stack.add(number, frame, Format.XDMF)
    assert stack is not None  # noqa: S101 (there is a grid)
    return stack.result(tuple(times) if len(times) == len(steps) else None)


def _frame(grid: Element, domain: Element, numbers: Callable[[Element], NDArray[Any]]) -> Frame:
    # A grid that repeats another's mesh (xi:include) has none of its own.
    topology, geometry = (
        next(domain.iter(tag), None) if (own := grid.find(tag)) is None else own
        for tag in ("Topology", "Geometry")
    )
    if topology is None or geometry is None:
        raise _malformed("A grid of the XDMF file has no mesh.")
    kind = topology.get("TopologyType", topology.get("Type", ""))
    if kind.lower() != "triangle":
        raise _malformed(f"The cells of the XDMF file are {kind[:40]!r}, not 'Triangle'.")
    positions = numbers(geometry).reshape(-1, 3)
    faces, _ = faces_in(numbers(topology).reshape(-1, 3), -1)
    notes: tuple[str, ...] = ()
    others = grid.findall("Attribute")
    moved = [one for one in others if one.get("Name", "").lower() in _DISPLACEMENT][:1]
    for one in moved:
        u = numbers(one).reshape(-1, 3)
        if u.shape != positions.shape:
            raise ShapeError(
                f"There are {len(u)} displacements of {len(positions)} vertices.",
                remedy="Save a displacement for each vertex.",
            )
        positions = positions + u
        notes = (f"The displacement {one.get('Name')!r} was added to the vertices.",)
    if positions.dtype != np.float32:
        positions = positions.astype(np.float64)
    ignored = tuple(one.get("Name", "")[:40] for one in others if one not in moved)
    return Frame(positions, faces, notes=notes, ignored=ignored)


def _numbers_of(
    beside: Callable[[str], bytes], parser: Parser
) -> Callable[[Element], NDArray[Any]]:
    """Give the reader of an element's numbers, which reads each file once."""

    @cache
    def datasets(name: str) -> dict[str, NDArray[Any]]:
        return parser.parse("datasets", beside(name)).arrays

    def numbers(element: Element) -> NDArray[Any]:
        item = element.find("DataItem")
        if item is None:
            raise _malformed(f"An element {element.tag!r} of the XDMF file has no numbers.")
        text = item.text or ""
        if item.get("Format", "XML").upper() == "XML":
            return np.array(text.split(), dtype=np.float64)
        name, _, place = text.strip().rpartition(":")
        if place.strip("/") not in datasets(name):
            raise _malformed(f"{name[-60:]!r} contains no dataset {place[:60]!r}.")
        return datasets(name)[place.strip("/")]

    return numbers
