"""VTKHDF whose steps have other points each, as observations of a track."""

from __future__ import annotations

import io
from collections.abc import Callable

import h5py
import numpy as np
import pytest

from modalmotion.errors import LimitError, MalformedFileError, NonFiniteError, ShapeError
from modalmotion.formats import ParserHere, ReadLimits, read_sequence, write_vtkhdf
from modalmotion.mesh.sequence import mesh_sequence, sequence_to_hdf5
from modalmotion.tracking.reading import Recorded, read_observed

SIZES = (5, 3, 7)
POINTS = np.random.default_rng(0).normal(size=(sum(SIZES), 3))
HERE = ParserHere(ReadLimits(frames=10, vertices=100))


def clouds(edit: Callable[[h5py.File], object] = lambda _: None) -> bytes:
    """Write clouds of three sizes, a part each."""
    one = mesh_sequence(np.zeros((3, 4, 3)), times=[0.0, 0.1, 0.3], unit="mm")
    buffer = io.BytesIO(write_vtkhdf(one))
    with h5py.File(buffer, "r+") as file:
        root = file["VTKHDF"]
        for name, values in (
            ("NumberOfPoints", SIZES),
            ("Points", POINTS),
            ("Steps/PointOffsets", np.cumsum([0, *SIZES[:-1]])),
            ("Steps/PartOffsets", np.arange(3)),
            *((f"Polygons/{name}", [0] * 3) for name in ("NumberOfCells", "Offsets")),
            ("Polygons/NumberOfConnectivityIds", [0] * 3),
        ):
            del root[name]
            root[name] = values
        edit(file)
    return buffer.getvalue()


def read(data: bytes) -> Recorded:
    return read_observed(data, parser=HERE)


def test_each_step_has_its_own_points_and_time() -> None:
    found = read(clouds())
    assert [len(frame[0]) for frame in found.frames] == list(SIZES)
    assert np.array_equal(found.frames[1][0].points, POINTS[5:8])
    assert found.times is not None
    assert found.times.tolist() == [0.0, 0.1, 0.3]
    assert found.unit == "mm"
    # Read as a sequence of one mesh, the file says where it belongs.
    with pytest.raises(ShapeError, match="Frame 1 has 3 vertices") as caught:
        read_sequence(clouds(), parser=HERE)
    assert "modalmotion track" in caught.value.remedy


def test_a_file_without_steps_is_one_frame() -> None:
    found = read(clouds(_one_part))
    assert [len(frame[0]) for frame in found.frames] == [5]
    assert found.times is None


def _one_part(file: h5py.File) -> None:
    del file["VTKHDF/Steps"], file["VTKHDF/NumberOfPoints"]
    file["VTKHDF/NumberOfPoints"] = [5]


def test_what_leads_nowhere_is_refused() -> None:
    def replaced(name: str, values: object) -> Callable[[h5py.File], None]:
        def edit(file: h5py.File) -> None:
            del file[f"VTKHDF/{name}"]
            file[f"VTKHDF/{name}"] = values

        return edit

    for name, values in (
        ("Steps/PointOffsets", [0, 5, 9]),
        ("Steps/PointOffsets", [0, -5, 8]),
        ("NumberOfPoints", [5, 3, -1]),
        ("Points", POINTS[:, :2]),
        ("Points", POINTS.astype(np.int64)),
    ):
        with pytest.raises(MalformedFileError):
            read(clouds(replaced(name, values)))
    broken = POINTS.copy()
    broken[6, 0] = np.nan
    with pytest.raises(NonFiniteError, match="Frame 1: Point 1"):
        read(clouds(replaced("Points", broken)))
    with pytest.raises(LimitError, match="frames"):
        read_observed(clouds(), parser=ParserHere(ReadLimits(frames=2)))
    with pytest.raises(LimitError, match="vertices"):
        read_observed(clouds(), parser=ParserHere(ReadLimits(vertices=6)))
    sequence = mesh_sequence(np.zeros((1, 4, 3)))
    with pytest.raises(MalformedFileError, match="no group 'VTKHDF'"):
        read(sequence_to_hdf5(sequence))
