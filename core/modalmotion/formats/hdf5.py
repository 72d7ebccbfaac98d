"""HDF5 files that contain a sequence: VTKHDF surfaces over time, and files of our own store."""

from __future__ import annotations

import numpy as np

from modalmotion.formats.parser.answer import Answer, Parser
from modalmotion.formats.parser.process import ParserProcess
from modalmotion.formats.result import Reading, Source
from modalmotion.limits import DEFAULT_LIMITS, ReadLimits
from modalmotion.mesh import facts_from_json
from modalmotion.mesh.checks import given_up
from modalmotion.mesh.sequence import MeshSequence, in_time_order, mesh_sequence


def read_hdf5(
    data: bytes,
    limits: ReadLimits = DEFAULT_LIMITS,
    parser: Parser | None = None,
    task: str = "hdf5",
) -> Reading:
    """Read a sequence from an HDF5 file: VTKHDF PolyData, one of the store's, or named datasets.

    The file is parsed in a process of its own, after the checks of `hdf5.sealed`.

    Parameters
    ----------
    data : bytes
    limits : ReadLimits, optional
    parser : Parser, optional
        Parser to reuse; its own limits apply.
    task : {"hdf5", "mat"}
        Its name: MATLAB's files of other versions hold the same.

    Raises
    ------
    MalformedFileError
        If the file is damaged, leads out of itself, or contains no sequence.
    LimitError
        If it declares more than `limits` accept.
    InputError
        If its arrays do not form a sequence.
    """
    if parser is None:
        with ParserProcess(limits) as own:
            return _result(own.parse(task, data))
    return _result(parser.parse(task, data))


def _result(answer: Answer) -> Reading:
    info, arrays = answer.info, answer.arrays
    vertices, times, notes = arrays["vertices"], arrays.get("times"), tuple[str, ...]()
    if times is not None and vertices.ndim == 3:
        vertices, times, notes = in_time_order(vertices, times)
    sequence: MeshSequence = mesh_sequence(
        given_up(vertices),
        arrays["faces"],
        grid=None if info["grid"] is None else np.array(info["grid"]),
        topology=info["topology"],
        times=times,
        unit=info["unit"],
        facts=facts_from_json(info.get("facts", {})),
    )
    stated: Source = "file"
    return Reading(
        sequence,
        ignored=tuple(info["ignored"]),
        format=str(info["format"]),
        coordinate_system=info.get("coordinate_system"),
        unit_from=None if sequence.unit is None else stated,
        times_from=None if sequence.times is None else stated,
        notes=(*info["notes"], *notes),
    )
