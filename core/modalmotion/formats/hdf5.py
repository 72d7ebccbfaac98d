"""HDF5 files that hold a sequence: VTKHDF surfaces over time, and files of our own store."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError, StoreError
from modalmotion.formats.hdf5_gate import open_gated
from modalmotion.formats.limits import DEFAULT_LIMITS, ReadLimits
from modalmotion.formats.parser.process import ParserProcess
from modalmotion.formats.parser.tasks import Answer, Parsed, Parser
from modalmotion.formats.result import ReadResult, Source
from modalmotion.formats.vtk.vtkhdf import parse_vtkhdf
from modalmotion.mesh.frame_order import in_time_order
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence

_OURS: Final = "modalmotion."


def read_hdf5(
    data: bytes, limits: ReadLimits = DEFAULT_LIMITS, parser: Parser | None = None
) -> ReadResult:
    """Read a sequence from an HDF5 file: VTKHDF PolyData, or one of the store's.

    The file is parsed in a process of its own, behind the gate of `hdf5_gate`.

    Parameters
    ----------
    data : bytes
    limits : ReadLimits, optional
    parser : Parser, optional
        One to use again; its own limits hold.

    Raises
    ------
    MalformedFileError
        If the file is damaged, leads out of itself, or holds no sequence.
    LimitError
        If it declares more than `limits` accept.
    InputError
        If its arrays make no sequence.
    """
    if parser is None:
        with ParserProcess(limits) as own:
            return _result(own.parse("hdf5", data))
    return _result(parser.parse("hdf5", data))


def parse_hdf5(data: bytes, limits: ReadLimits) -> Parsed:
    """Parse an HDF5 file in this process; see `read_hdf5`."""
    with open_gated(data, limits) as file:
        if "VTKHDF" in file:
            return parse_vtkhdf(file, limits)
        schema = file.attrs.get("schema")
        names = ", ".join(repr(str(name)[:40]) for name in list(file)[:8]) or "nothing"
    text = schema.decode("utf-8", "replace") if isinstance(schema, bytes) else str(schema)
    if not text.startswith(_OURS):
        raise MalformedFileError(
            f"The HDF5 file holds {names}: neither a group 'VTKHDF' nor a sequence of ours.",
            remedy="Send VTKHDF PolyData, the file that modalmotion gave, or npz.",
        )
    return _parse_ours(data, limits)


def _parse_ours(data: bytes, limits: ReadLimits) -> Parsed:
    from modalmotion.mesh.hdf5 import sequence_from_hdf5

    try:
        sequence = sequence_from_hdf5(data)
    except StoreError as error:
        raise MalformedFileError(error.message, remedy=error.remedy) from error
    limits.require("frames", sequence.n_frames)
    limits.require("vertices", sequence.n_vertices)
    limits.require("faces", len(sequence.faces))
    arrays: dict[str, NDArray[Any]] = {"vertices": sequence.vertices, "faces": sequence.faces}
    if sequence.times is not None:
        arrays["times"] = sequence.times
    info: dict[str, Any] = {
        "format": "hdf5",
        "unit": sequence.unit,
        "topology": None if sequence.topology is None else sequence.topology.name,
        "grid": sequence.grid,
        "ignored": [],
        "notes": [],
    }
    return info, arrays


def _result(answer: Answer) -> ReadResult:
    info, arrays = answer.info, answer.arrays
    vertices, times, notes = arrays["vertices"], arrays.get("times"), tuple[str, ...]()
    if times is not None and vertices.ndim == 3:
        vertices, times, notes = in_time_order(vertices, times)
    sequence: MeshSequence = mesh_sequence(
        vertices,
        arrays["faces"],
        grid=None if info["grid"] is None else np.array(info["grid"]),
        topology=info["topology"],
        times=times,
        unit=info["unit"],
    )
    stated: Source = "file"
    return ReadResult(
        sequence,
        ignored=tuple(info["ignored"]),
        format=str(info["format"]),
        coordinate_system=info.get("coordinate_system"),
        unit_from=None if sequence.unit is None else stated,
        times_from=None if sequence.times is None else stated,
        notes=(*info["notes"], *notes),
    )
