"""Files that hold one mesh each: the right reader for the bytes."""

from __future__ import annotations

import importlib.util
import re
from typing import Final

from modalmotion.errors import MalformedFileError, needs_extra
from modalmotion.formats.detect import MESH_FORMATS, Format, detect_format, unknown_format
from modalmotion.formats.frames.frame import Frame
from modalmotion.formats.obj import read_obj
from modalmotion.formats.off import read_off
from modalmotion.formats.parser.answer import Parser
from modalmotion.formats.ply.ply import read_ply
from modalmotion.formats.polygons import triangulate
from modalmotion.formats.stl import read_stl

_READERS: Final = {
    Format.STL: read_stl,
    Format.PLY: read_ply,
    Format.OBJ: read_obj,
    Format.OFF: read_off,
}
# What a file of VTK says of its size near its beginning, and the limit on it.
_DECLARED: Final = {
    Format.VTK: (
        ("vertices", rb"(?m)^POINTS[ \t]+(\d{1,18})[ \t]"),
        ("faces", rb"(?m)^POLYGONS[ \t]+(\d{1,18})[ \t]"),
    ),
    Format.VTP: (
        ("vertices", rb"\sNumberOfPoints=[\"'](\d{1,18})[\"']"),
        ("faces", rb"\sNumberOfPolys=[\"'](\d{1,18})[\"']"),
    ),
}


def read_mesh(data: bytes, stated: Format | None, parser: Parser) -> tuple[Frame, Format]:
    """Read a file that holds one mesh.

    Parameters
    ----------
    data : bytes
    stated : Format or None
        Recognised from the content where it is None.
    parser : Parser
        For the formats that need one; its limits hold for all.

    Returns
    -------
    frame : Frame
    format : Format

    Raises
    ------
    InputError
        The subclass says what is wrong.
    """
    kind = detect_format(data) if stated is None else stated
    if kind is None:
        raise unknown_format(data)
    if kind not in MESH_FORMATS:
        raise MalformedFileError(
            f"The file is {kind.upper()}, which holds a whole sequence or none.",
            remedy="Send such a file by itself, not as a frame.",
        )
    if kind in _READERS:
        return _READERS[kind](data, parser.limits), kind
    return _read_vtk(data, kind, parser), kind


def _read_vtk(data: bytes, kind: Format, parser: Parser) -> Frame:
    with needs_extra("vtk"):
        if importlib.util.find_spec("vtkmodules") is None:
            raise ModuleNotFoundError(name="vtk")
    if kind is Format.VTP:
        prolog = data.partition(b"<VTKFile")[0]
        if b"<!" in prolog.replace(b"<!--", b""):
            raise MalformedFileError(
                "The .vtp file holds a document type, which is never read.",
                remedy="Save the frame again without it.",
            )
    # Told before memory is asked for; the process that parses is limited as well.
    for limit, pattern in _DECLARED[kind]:
        for count in re.findall(pattern, data[: 1 << 20]):
            parser.limits.require(limit, int(count))
    answer = parser.parse(kind.value, data)
    polygons = triangulate(answer.arrays["offsets"], answer.arrays["corners"])
    return Frame(
        answer.arrays["positions"],
        polygons.faces,
        notes=polygons.notes,
        ignored=tuple(answer.info["ignored"]),
        statements=tuple((str(name), str(value)) for name, value in answer.info["statements"]),
    )
