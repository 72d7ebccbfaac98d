"""Files of one mesh each: the right reader for the bytes."""

from __future__ import annotations

import importlib.util
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
from modalmotion.formats.vtk.legacy_gate import require_plain_legacy
from modalmotion.formats.vtk.xml_gate import require_plain_xml

_READERS: Final = {
    Format.STL: read_stl,
    Format.PLY: read_ply,
    Format.OBJ: read_obj,
    Format.OFF: read_off,
}
_GATES: Final = {
    Format.VTK: require_plain_legacy,
    Format.VTP: require_plain_xml,
    Format.VTU: require_plain_xml,
}


def read_mesh(data: bytes, stated: Format | None, parser: Parser) -> tuple[Frame, Format]:
    """Read a file that contains one mesh.

    Parameters
    ----------
    data : bytes
    stated : Format or None
        Recognised by content if None.
    parser : Parser
        For the formats that need one; its limits apply to all.

    Returns
    -------
    frame : Frame
    format : Format

    Raises
    ------
    InputError
        The subclass names the problem.
    """
    kind = detect_format(data) if stated is None else stated
    if kind is None:
        raise unknown_format(data)
    if kind not in MESH_FORMATS:
        raise MalformedFileError(
            f"The file is {kind.upper()}, which contains a whole sequence or none.",
            remedy="Send such a file by itself, not as a frame.",
        )
    if kind in _READERS:
        return _READERS[kind](data, parser.limits), kind
    return _read_vtk(data, kind, parser), kind


def _read_vtk(data: bytes, kind: Format, parser: Parser) -> Frame:
    with needs_extra("vtk"):
        if importlib.util.find_spec("vtkmodules") is None:
            raise ModuleNotFoundError(name="vtk")
    # Before memory is allocated; the parser's process is limited as well.
    _GATES[kind](data, parser.limits)
    answer = parser.parse(kind.value, data)
    polygons = triangulate(answer.arrays["offsets"], answer.arrays["corners"])
    return Frame(
        answer.arrays["positions"],
        polygons.faces,
        notes=polygons.notes,
        ignored=tuple(answer.info["ignored"]),
        statements=tuple((str(name), str(value)) for name, value in answer.info["statements"]),
    )
