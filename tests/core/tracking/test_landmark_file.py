"""Files of landmarks: places as stated, turned once to the points' coordinate system."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from modalmotion.errors import InputError, MalformedFileError, ParameterError, ShapeError
from modalmotion.formats.ply import write_ply
from modalmotion.tracking import track
from modalmotion.tracking.landmarks import read_landmark_file
from modalmotion.tracking.reading import read_observed


def slicer(system: str = "LPS", *points: tuple[str, list[float]], **more: Any) -> bytes:
    """Write a file as Slicer 5 does."""
    controls = [
        {"id": str(k), "label": label, "position": place, "positionStatus": "defined"}
        for k, (label, place) in enumerate(points)
    ]
    markup = {"type": "Fiducial", "coordinateSystem": system, "controlPoints": controls, **more}
    return json.dumps(
        {"@schema": "https://...markups-schema-v1.0.3.json#", "markups": [markup]}
    ).encode()


ENDS = (("apex", [1.0, 2.0, 3.0]), ("Base-1", [4.0, 0.0, 8.0]), ("base_2", [6.0, 0.0, 8.0]))


def test_slicers_points_are_read_and_several_of_a_name_are_their_middle() -> None:
    file = read_landmark_file(slicer("LPS", *ENDS, ("F-1", [0.0, 0.0, 0.0]), coordinateUnits="mm"))
    assert file.places["apex"].tolist() == [1, 2, 3]
    assert file.places["base"].tolist() == [5, 0, 8]
    assert (file.coordinates, file.unit) == ("LPS", "mm")
    assert "F-1" in file.notes[0]


@pytest.mark.parametrize(
    ("system", "points", "expected"),
    [
        ("LPS", "LPS", [1, 2, 3]),
        ("LPS", "RAS", [-1, -2, 3]),
        ("RAS", "LPS", [-1, -2, 3]),
        ("RAS", "RAS", [1, 2, 3]),
        ("RAS", None, [-1, -2, 3]),
        ("LPS", None, [1, 2, 3]),
    ],
)
def test_places_are_turned_once_to_the_system_of_the_points(
    system: str, points: str | None, expected: list[float]
) -> None:
    for data in (
        slicer(system, *ENDS),
        json.dumps({"coordinates": system, "landmarks": {"apex": [1, 2, 3]}}).encode(),
    ):
        assert read_landmark_file(data).for_points(points, None)["apex"].tolist() == expected


def test_ours_has_a_place_or_one_for_each_frame_and_no_system_turns_nothing() -> None:
    data = b'{"landmarks": {"apex": [[1, 2, 3], null], "base": [4, 5, 6]}, "unit": "mm"}'
    found = read_landmark_file(data).for_points("RAS", None)
    assert found["apex"][0].tolist() == [1, 2, 3]
    assert np.isnan(found["apex"][1]).all()
    with pytest.raises(ParameterError, match="in mm, the points in cm"):
        read_landmark_file(data).for_points(None, "cm")


@pytest.mark.parametrize(
    ("data", "match"),
    [
        (b"", "not a landmark file"),
        (b"\xff\xfe", "not a landmark file"),
        (b"[1]", "it is a list"),
        (b"{}", "neither 'landmarks' nor 'markups'"),
        (b'{"landmarks": {"apex": "1,2,3"}}', "three finite numbers"),
        (b'{"landmarks": {"apex": [1, 2, 3]}, "coordinates": "LAS"}', "'LAS'"),
        (b'{"markups": [{"controlPoints": [{"label": "apex"}]}]}', "no control points with"),
        (b'{"markups": [3]}', "no control points with"),
        (slicer("LPS", ("F-1", [0.0, 0.0, 0.0])), "called apex or base: 'F-1'"),
        (slicer("LPS"), "there are none"),
    ],
)
def test_what_is_none_is_said(data: bytes, match: str) -> None:
    with pytest.raises(InputError, match=match) as caught:
        read_landmark_file(data)
    assert caught.value.remedy


def frames_in(folder: Path, *systems: str) -> Path:
    """Write three clouds, or one that states each coordinate system."""
    rng = np.random.default_rng(0)
    for k, system in enumerate(systems or ("", "", "")):
        cloud = rng.normal(size=(20, 3)) * 9.0
        content = write_ply(cloud, np.zeros((0, 3), np.int64), {})
        if system:
            start, rest = content.split(b"element", 1)
            content = start + f"comment SPACE={system}\nelement".encode() + rest
        (folder / f"scan_{k}.ply").write_bytes(content)
    return folder


def test_files_among_frames_belong_to_all_or_to_the_frame_of_their_name(tmp_path: Path) -> None:
    frames_in(tmp_path)
    (tmp_path / "landmarks.json").write_text('{"landmarks": {"base": [7, 8, 9]}}')
    (tmp_path / "scan_1.mrk.json").write_bytes(slicer("LPS", ENDS[0]))
    (tmp_path / "scan_2.mrk.json").write_bytes(slicer("RAS", ENDS[0]))
    (tmp_path / "other.json").write_text("{}")
    found = read_observed(tmp_path)
    assert len(found.frames) == 3
    assert found.landmarks["base"].tolist() == [7, 8, 9]
    assert np.isnan(found.landmarks["apex"][0]).all()
    assert found.landmarks["apex"][1:].tolist() == [[1, 2, 3], [-1, -2, 3]]
    turned = read_observed(tmp_path, coordinates="RAS")
    assert turned.landmarks["apex"][1:].tolist() == [[-1, -2, 3], [1, 2, 3]]
    (tmp_path / "scan_2.mrk.json").write_bytes(b"{}")
    with pytest.raises(MalformedFileError, match=r"'scan_2.mrk.json': It is not a landmark file"):
        read_observed(tmp_path)


def test_a_landmark_of_all_frames_may_be_another_in_one(tmp_path: Path) -> None:
    frames_in(tmp_path)
    (tmp_path / "landmarks.json").write_text('{"landmarks": {"apex": [7, 8, 9]}}')
    (tmp_path / "scan_1.mrk.json").write_bytes(slicer("LPS", ENDS[0]))
    found = read_observed(tmp_path)
    assert found.landmarks["apex"].tolist() == [[7, 8, 9], [1, 2, 3], [7, 8, 9]]


def test_a_landmark_far_from_all_points_is_refused(tmp_path: Path) -> None:
    recorded = read_observed(frames_in(tmp_path))
    far = {"apex": [0, 0, -9], "base": [500.0, 0, 9]}
    with pytest.raises(ParameterError, match=r"'base' in frame 0 is .* from the points") as caught:
        track(recorded, modes=4, landmarks=far)
    assert caught.value.frame == 0
    assert "LPS and RAS" in caught.value.remedy


def test_frames_in_two_coordinate_systems_are_refused(tmp_path: Path) -> None:
    frames_in(tmp_path, "RAS", "LPS")
    with pytest.raises(ShapeError, match=r"Frame 1 .*system is LPS, that of frame 0 RAS"):
        read_observed(tmp_path)
    (tmp_path / "scan_1.ply").unlink()
    (tmp_path / "landmarks.json").write_bytes(slicer("LPS", *ENDS))
    found = read_observed(tmp_path)
    assert found.coordinates == "RAS"
    assert found.landmarks["apex"].tolist() == [-1, -2, 3]
