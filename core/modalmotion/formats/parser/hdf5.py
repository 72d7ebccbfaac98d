"""Parser of HDF5 files: VTKHDF surfaces over time, and files of our own store."""

from __future__ import annotations

from typing import Any, Final

from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError, StoreError
from modalmotion.formats.frame import NOTHING_TO_TRACK
from modalmotion.formats.named_arrays import parse_datasets as parse_named
from modalmotion.formats.result import Parsed
from modalmotion.formats.vtkhdf import parse_vtkhdf, parse_vtkhdf_clouds
from modalmotion.hdf5.form import Form
from modalmotion.hdf5.sealed import open_gated
from modalmotion.limits import ReadLimits
from modalmotion.mesh import facts_as_json
from modalmotion.mesh.hdf5 import FORM, TRACK, sequence_from_hdf5

_OURS: Final = "modalmotion."
_OF_TRACK: Final = "The file is a track: its surface was read, without the errors that it states."


def parse_hdf5(data: bytes, limits: ReadLimits) -> Parsed:
    """Parse VTKHDF PolyData, a file of the store's, or named datasets, after `open_gated`."""
    with open_gated(data, limits) as file:
        if "VTKHDF" in file:
            return parse_vtkhdf(file, limits)
        schema = file.attrs.get("schema")
        text = schema.decode("utf-8", "replace") if isinstance(schema, bytes) else str(schema)
        if not text.startswith(_OURS):
            return parse_named(file, limits)
    return _parse_ours(data, limits, TRACK if text == f"{_OURS}{TRACK.kind}" else FORM)


def parse_datasets(data: bytes, limits: ReadLimits) -> Parsed:
    """Give all datasets of numbers in an HDF5 file by their paths, in this process."""
    arrays: dict[str, NDArray[Any]] = {}

    def take(name: str, value: Any) -> None:
        if getattr(value, "shape", None) is not None and value.dtype.kind in "fiu":
            arrays[name] = value[()]

    with open_gated(data, limits) as file:
        file.visititems(take)
    return {}, arrays


def parse_clouds(data: bytes, limits: ReadLimits) -> Parsed:
    """Parse the points of a VTKHDF file in this process: see `parse_vtkhdf_clouds`."""
    with open_gated(data, limits) as file:
        if "VTKHDF" in file:
            return parse_vtkhdf_clouds(file, limits)
    raise MalformedFileError(
        "The HDF5 file contains no group 'VTKHDF'.",
        remedy=f"Send VTKHDF PolyData, or npz. {NOTHING_TO_TRACK}",
    )


def _parse_ours(data: bytes, limits: ReadLimits, form: Form) -> Parsed:
    try:
        sequence = sequence_from_hdf5(data, form)
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
        "facts": facts_as_json(sequence.facts),
        "ignored": [],
        "notes": [_OF_TRACK] if form == TRACK else [],
    }
    return info, arrays
