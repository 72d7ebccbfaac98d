"""Mesh sequences as HDF5."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from modalmotion.hdf5.form import Form
from modalmotion.hdf5.image import UNKNOWN, Contents, Dataset, json_text
from modalmotion.mesh.checks import given_up
from modalmotion.mesh.fact_forms import facts_as_json, facts_from_json
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence

FORM: Final = Form("sequence", 2)
"""Version 1 had no facts."""

TRACK: Final = Form("track", 3)
"""Of a track, which contains its sequence in the same way."""


def sequence_to_hdf5(sequence: MeshSequence) -> bytes:
    """Write a mesh sequence as a sealed HDF5 file in memory.

    Parameters
    ----------
    sequence : MeshSequence

    Returns
    -------
    bytes
        The same for the same sequence.
    """
    unit = sequence.unit or UNKNOWN
    vertices = sequence.vertices.astype(sequence.vertices.dtype.newbyteorder("<"), copy=False)
    datasets = [
        Dataset("vertices", vertices, unit, "frame, vertex, direction"),
        Dataset("faces", sequence.faces.astype("<i8", copy=False), "1", "face, corner"),
        json_text("facts", facts_as_json(sequence.facts)),
    ]
    if sequence.times is not None:
        datasets.append(Dataset("times", sequence.times, "s", "frame"))
    return FORM.image(
        {"sequence_id": sequence.id},
        datasets,
        unit=unit,
        topology=None if sequence.topology is None else sequence.topology.name,
        grid=sequence.grid,
    )


def sequence_from_hdf5(source: bytes | Path, form: Form = FORM) -> MeshSequence:
    """Read a mesh sequence, bit for bit as written.

    Parameters
    ----------
    source : bytes or Path
    form : Form
        `TRACK` reads the sequence of a track, without its errors.

    Raises
    ------
    StoreError
        As in `Form.read`.
    """
    return read_sequence(source, form)[0]


def read_sequence(source: bytes | Path, form: Form = FORM) -> tuple[MeshSequence, Contents]:
    """Read a mesh sequence together with the contents of its file."""
    with form.read(source) as contents:
        sequence = mesh_sequence(
            given_up(contents.array("vertices", (None, None, 3))),
            contents.array("faces", (None, 3)),
            grid=contents.attributes.get("grid"),
            topology=contents.optional_text("topology"),
            times=contents.arrays.get("times"),
            unit=contents.unit,
            facts=facts_from_json(contents.json("facts", dict)),
        )
        return sequence, contents
