"""Observations from files: meshes, clouds and contours, one a frame, or all in one npz."""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from clouds import breathing_spheroid, sampled

from modalmotion.errors import InputError, MalformedFileError, ParameterError
from modalmotion.formats import read_npz
from modalmotion.formats.frame_files import write_ply_zip
from modalmotion.formats.ply import write_ply
from modalmotion.progress import Progress
from modalmotion.tracking.reading import read_observed

BALL = breathing_spheroid(3)
X = BALL.vertices.astype(np.float64)
HEADING = "x\ty\tz\tcontour type\tframeID\tweight\ttime frame"


def test_meshes_of_other_connectivity_come_in_natural_order(tmp_path: Path) -> None:
    for k, number in enumerate((1, 2, 10)):
        faces = BALL.faces[k:]
        (tmp_path / f"scan_{number}.ply").write_bytes(write_ply(X[k], faces, {}))
    (tmp_path / "notes.md").write_text("none")
    seen: list[Progress] = []
    found = read_observed(tmp_path, progress=seen.append)
    assert [frame[0].points[5] for frame in found.frames] == [pytest.approx(x[5]) for x in X]
    assert found.frames[0][0].weights is not None
    assert seen == [Progress(k, 3) for k in (1, 2, 3)]


def test_clouds_are_text_or_ply_without_triangles(tmp_path: Path) -> None:
    (tmp_path / "a_1.csv").write_text("x,y,z\n1,2,3\n4,5,6\n")
    (tmp_path / "a_2.xyz").write_text("1 2 3 255 0 0\n\n4;5;6\n")
    (tmp_path / "a_3.ply").write_bytes(write_ply(X[0][:4], np.zeros((0, 3), np.int64), {}))
    found = read_observed(tmp_path)
    assert [len(frame[0]) for frame in found.frames] == [2, 2, 4]
    assert found.frames[0][0].points[1].tolist() == [4.0, 5.0, 6.0]


@pytest.mark.parametrize("first", ["-.5 0 1", "+.5 0 1", "\ufeff-0.5 0 1"])
def test_no_first_point_is_taken_for_a_heading(tmp_path: Path, first: str) -> None:
    (tmp_path / "a_1.xyz").write_text(f"{first}\n4 5 6\n")
    assert len(read_observed(tmp_path).frames[0][0]) == 2
    for number in ("inf", "-nan"):
        (tmp_path / "a_1.xyz").write_text(f"{number} 0 1\n4 5 6\n")
        with pytest.raises(InputError, match="not finite"):
            read_observed(tmp_path)


def test_a_table_may_have_a_byte_order_mark_and_no_rows() -> None:
    found = read_observed("\ufeffframe,x,y,z\n0,1,2,3\n1,4,5,6\n".encode())
    assert [len(frame[0]) for frame in found.frames] == [1, 1]
    assert read_observed(b"frame,x,y,z\n").frames == ()


def test_a_zip_is_read_as_its_folder(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for k in range(3):
            archive.writestr(f"in/f{k}.xyz", "\n".join(" ".join(map(str, p)) for p in X[k][:9]))
    (tmp_path / "frames.zip").write_bytes(buffer.getvalue())
    found = read_observed(tmp_path / "frames.zip")
    assert found.frames[2][0].points == pytest.approx(X[2][:9])


def test_an_npz_has_points_and_offsets(tmp_path: Path) -> None:
    clouds = [sampled(x, BALL.faces, 20 + k, np.random.default_rng(k)) for k, x in enumerate(X)]
    path = tmp_path / "clouds.npz"
    offsets = np.cumsum([0, *map(len, clouds)])
    np.savez(path, points=np.concatenate(clouds), offsets=offsets, unit="mm", apex=np.zeros(3))
    found = read_observed(path)
    assert [len(frame[0]) for frame in found.frames] == [20, 21, 22]
    assert found.unit == "mm"
    assert found.landmarks["apex"].tolist() == [0.0, 0.0, 0.0]
    np.savez(path, points=np.concatenate(clouds), offsets=offsets[:-1])
    with pytest.raises(MalformedFileError, match="offsets do not run"):
        read_observed(path)
    np.savez(path, vertices=X)
    with pytest.raises(MalformedFileError, match="no 'points'") as caught:
        read_observed(path)
    assert "needs no tracking" in caught.value.remedy
    broken = np.concatenate(clouds)
    broken[25, 1] = np.nan
    np.savez(path, points=broken, offsets=offsets)
    with pytest.raises(InputError, match=r"Frame 1: Point 5 is not finite") as wrong:
        read_observed(path)
    assert wrong.value.frame == 1
    whole = path.read_bytes()
    for content in (b"", whole[: len(whole) // 2], b"\x93NUMPY" + bytes(200)):
        path.write_bytes(content)
        with pytest.raises(MalformedFileError, match=r"empty|cut short|single array"):
            read_observed(path)


def test_an_npz_of_equal_frames_needs_no_offsets(tmp_path: Path) -> None:
    path, clouds = tmp_path / "clouds.npz", X[:, :30].copy()
    # Frames of fewer points are filled up.
    clouds[1, 25:] = np.nan
    np.savez(path, points=clouds, unit="mm")
    found = read_observed(path)
    assert [len(frame[0]) for frame in found.frames] == [30, 25, 30]
    assert found.frames[2][0].points == pytest.approx(X[2, :30])
    assert found.unit == "mm"
    # A coordinate alone is a mistake, and another shape is one too.
    clouds[1, 3, 0] = np.nan
    np.savez(path, points=clouds)
    with pytest.raises(InputError, match=r"Frame 1: Point 3 is not finite"):
        read_observed(path)
    np.savez(path, points=X[0])
    with pytest.raises(MalformedFileError, match="the frame offsets are missing") as caught:
        read_observed(path)
    assert "points (frames, n, 3)" in caught.value.remedy
    # What is a sequence to others stays one: curves and lattices have vertices.
    with pytest.raises(MalformedFileError, match="no 'vertices'") as sent:
        read_npz(path.read_bytes())
    assert "modalmotion track" in sent.value.remedy


def test_guide_points_are_contours_with_landmarks(tmp_path: Path) -> None:
    for k in range(2):
        rows = [HEADING, f"1\t2\t{k}\tSAX_LV_ENDOCARDIAL\t2\t1.0\t0"]
        rows += [f"4\t5\t6\tSAX_LV_EPICARDIAL\t2\t1.0\t{k}", f"0\t0\t9\tMITRAL_VALVE\t1\t1.0\t{k}"]
        if k == 0:
            rows += ["0\t0\t-9\tAPEX_POINT\t1\t1.0\t0"]
        (tmp_path / f"GPFile_{k:03d}.txt").write_text("\n".join(rows))
    (tmp_path / "SliceInfoFile.txt").write_text("image.dcm\tsliceID:\t1")
    found = read_observed(tmp_path)
    assert found.frames[1][0].points.tolist() == [[1.0, 2.0, 1.0]]
    assert found.frames[1][1].points.tolist() == [[0, 0, 9]]
    assert found.frames[1][1].end == "base"
    assert found.landmarks["apex"][0].tolist() == [0, 0, -9]
    assert np.isnan(found.landmarks["apex"][1]).all()
    outer = read_observed(tmp_path, labels=["LV_EPICARDIAL"])
    assert outer.frames[0][0].points.tolist() == [[4.0, 5.0, 6.0]]
    assert outer.landmarks["base"].tolist() == [[0, 0, 9], [0, 0, 9]]
    with pytest.raises(ParameterError, match="SAX_LV_ENDOCARDIAL"):
        read_observed(tmp_path, labels=["AORTA_WALL"])


def test_guide_points_may_have_more_columns_and_long_words(tmp_path: Path) -> None:
    row = "1\t2\t3\tSAX_LV_ENDOCARDIAL\t2\t1.0\t0\t"
    # A table of texts as long as the longest one would take 25 GB.
    (tmp_path / "GPFile_000.txt").write_text("\n".join([*[row] * 999, row + "a" * 900_000]))
    assert len(read_observed(tmp_path).frames[0][0]) == 1000
    (tmp_path / "GPFile_000.txt").write_text(
        "\n".join([*[row] * 999, row.replace("\t1.0", "\t" + "1" * 999)])
    )
    assert len(read_observed(tmp_path).frames[0][0]) == 1000


def test_two_time_frames_in_one_file_are_refused_by_name(tmp_path: Path) -> None:
    rows = [HEADING, *(f"1\t{k}\t0\tSAX_LV_ENDOCARDIAL\t2\t1.0\t{k}" for k in range(2))]
    file = tmp_path / "GPFile_000.txt"
    # A slice whose weight stands in place of its frame is of no other one.
    file.write_text("\n".join([*rows[:-1], rows[-1].removesuffix("1") + "1.0"]))
    assert len(read_observed(tmp_path).frames) == 1
    file.write_text("\n".join(rows))
    with pytest.raises(
        MalformedFileError, match=r"GPFile_000.*SAX_LV_ENDOCARDIAL has points of two time frames"
    ):
        read_observed(tmp_path)


def test_valve_points_between_those_farthest_apart_are_no_rim(tmp_path: Path) -> None:
    rows = [HEADING, "1\t2\t0\tSAX_LV_ENDOCARDIAL\t2\t1.0\t0"]
    places = [(-9, "MITRAL_VALVE"), (2, "MITRAL_VALVE"), (3, "AORTA_VALVE"), (12, "AORTA_VALVE")]
    rows += [f"{x}\t0\t0\t{kind}\t8\t1.0\t0" for x, kind in places]
    rows += [f"0\t{y}\t0\tMITRAL_VALVE\t9\t1.0\t0" for y in (-8, 8)]
    (tmp_path / "GPFile_000.txt").write_text("\n".join(rows))
    (frame,) = read_observed(tmp_path).frames
    assert sorted(frame[1].points[:, 0].tolist()) == [-9, 0, 0, 12]


def test_what_cannot_be_read_names_frame_and_file(tmp_path: Path) -> None:
    with pytest.raises(MalformedFileError, match="None of 0 files"):
        read_observed(tmp_path)
    (tmp_path / "a_1.xyz").write_text("1 2 3\n")
    (tmp_path / "a_2.xyz").write_text("1 2 3\n4 five 6\n")
    with pytest.raises(
        InputError, match=r"Frame 1 \('a_2.xyz'\): A cell is not a number"
    ) as caught:
        read_observed(tmp_path)
    assert caught.value.frame == 1
    (tmp_path / "a_2.xyz").write_text("1 2 3\nnan 0 0\n")
    with pytest.raises(InputError, match=r"Frame 1 .*not finite"):
        read_observed(tmp_path)
    with pytest.raises(MalformedFileError, match="Unrecognised file format"):
        read_observed(tmp_path / "a_1.xyz")


def test_times_and_unit_come_from_the_frames_or_their_list() -> None:
    timed = replace(BALL, times=np.array([0.0, 0.1, 0.4]))
    found = read_observed(write_ply_zip(timed))
    assert found.times is not None
    assert found.times.tolist() == [0.0, 0.1, 0.4]
    assert found.unit == "mm"
    assert read_observed(write_ply_zip(BALL)).times is None
    # In the order of the list, not of the names.
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for k in range(2):
            archive.writestr(f"f{k}.ply", write_ply(X[k][:9], np.zeros((0, 3), np.int64), {}))
        entries = [{"name": f"f{k}.ply", "time": 1.0 - k} for k in range(2)]
        listed = {"file-series-version": "1.0", "files": entries}
        archive.writestr("all.ply.series", json.dumps(listed))
    turned = read_observed(buffer.getvalue())
    assert turned.frames[0][0].points == pytest.approx(X[1][:9])
    one = read_observed(write_ply(X[0], BALL.faces, {"unit": "cm"}))
    assert (len(one.frames), one.unit) == (1, "cm")


def test_landmarks_stand_in_an_npz_as_text_too(tmp_path: Path) -> None:
    text = '{"apex": [[0, 0, 1], null], "base": [1, 2, 3]}'
    arrays = {"points": X[0][:8], "offsets": [0, 4, 8], "landmarks": text, "coordinates": "RAS"}
    np.savez(tmp_path / "a.npz", **arrays)
    found = read_observed(tmp_path / "a.npz")
    assert found.landmarks["base"].tolist() == [1, 2, 3]
    assert np.isnan(found.landmarks["apex"][1]).all()
    assert found.coordinates == "RAS"
    np.savez(tmp_path / "a.npz", **{**arrays, "apex": "0,0,1"})
    with pytest.raises(InputError, match="'apex' contains") as caught:
        read_observed(tmp_path / "a.npz")
    assert "as numbers" in caught.value.remedy
