"""Files of a table: sequences as they are, observations tracked first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from clouds import as_npz, breathing_spheroid, sampled, small_recording

from modalmotion.errors import ConnectivityError, MalformedFileError, ParameterError
from modalmotion.formats import ReadOptions, read_sequence, write_npz
from modalmotion.formats.ply import write_ply
from modalmotion.mesh import Facts
from modalmotion.tracking.hdf5 import track_to_hdf5
from modalmotion.tracking.reading import read_observed
from modalmotion.tracking.recordings import sequence_of, track

BALL = breathing_spheroid(2)


def test_a_sequence_of_one_mesh_is_read_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "beat.npz").write_bytes(write_npz(BALL))
    assert sequence_of(tmp_path / "beat.npz").id == BALL.id


def test_a_track_is_its_sequence_with_its_errors(tmp_path: Path) -> None:
    (tmp_path / "clouds.npz").write_bytes(small_recording(2))
    made = track(read_observed(tmp_path / "clouds.npz"), modes=4)
    (tmp_path / "beat.h5").write_bytes(track_to_hdf5(made))
    found = sequence_of(tmp_path / "beat.h5", ReadOptions(facts=Facts(cavity="lv")))
    assert found.id == made.sequence.id
    assert (found.facts.tracking, found.facts.cavity) == ("normal_displacement", "lv")
    assert found.uncertainty is not None
    # To who reads bytes, it is a sequence like any other.
    read = read_sequence((tmp_path / "beat.h5").read_bytes())
    assert (read.sequence.id, read.sequence.facts) == (made.sequence.id, made.sequence.facts)
    assert read.notes[0].text.startswith("The file is a track")


def test_clouds_are_tracked_with_the_facts_of_their_row(tmp_path: Path) -> None:
    (tmp_path / "clouds.npz").write_bytes(small_recording(2))
    facts = Facts(covariates={"age": 61})
    found = sequence_of(tmp_path / "clouds.npz", ReadOptions(facts=facts, frame_interval=0.1))
    assert (found.n_frames, found.unit, found.facts.tracking) == (2, "mm", "normal_displacement")
    assert found.facts.covariates["age"] == 61
    assert found.times is not None
    with pytest.raises(ParameterError, match="'tracking' is 'material'"):
        sequence_of(tmp_path / "clouds.npz", ReadOptions(facts=Facts(tracking="material")))


def test_landmarks_of_a_row_place_the_start(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    cup = [sampled(x, BALL.faces, 300, rng) for x in BALL.vertices.astype(np.float64)]
    (tmp_path / "cup.npz").write_bytes(as_npz([x[x[:, 2] < 20.0] for x in cup]))
    ends = Facts(landmarks={"apex": (0.0, 0.0, -40.0), "base": (0.0, 0.0, 20.0)})
    found = sequence_of(tmp_path / "cup.npz", ReadOptions(facts=ends))
    assert found.topology is not None
    assert found.topology.name == "cup"
    assert found.facts.landmarks == ends.landmarks


def test_a_changing_mesh_is_tracked_only_where_its_row_says_so(tmp_path: Path) -> None:
    for k, x in enumerate(BALL.vertices):
        (tmp_path / f"f{k}.ply").write_bytes(write_ply(x, BALL.faces[k:], {}))
    with pytest.raises(ConnectivityError, match="It has") as caught:
        sequence_of(tmp_path)
    assert "set tracking to normal_displacement in its row" in caught.value.remedy
    found = sequence_of(tmp_path, ReadOptions(facts=Facts(tracking="normal_displacement")))
    assert found.n_frames == 2


@pytest.mark.parametrize("labels", [3, "LV_EPICARDIAL", (3.7,), (None,), None])
def test_labels_are_a_list_of_numbers_or_names(labels: object) -> None:
    with pytest.raises(ParameterError, match="The labels are") as caught:
        track(BALL, modes=4, labels=labels)
    assert "such as (3,)" in caught.value.remedy


@pytest.mark.parametrize("landmarks", [[1, 2], "apex", ()])
def test_landmarks_have_names(landmarks: object) -> None:
    with pytest.raises(ParameterError, match="without names") as caught:
        track(BALL, modes=4, landmarks=landmarks)
    assert '"apex"' in caught.value.remedy


def test_what_is_neither_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.npz").write_bytes(b"nothing")
    with pytest.raises(MalformedFileError):
        sequence_of(tmp_path / "notes.npz")
