"""Tracks in files: bit for bit, and closed to what was altered."""

from __future__ import annotations

import io
from dataclasses import replace

import h5py
import numpy as np
import pytest
from clouds import breathing_spheroid, sampled

from modalmotion.errors import CorruptFileError
from modalmotion.mesh import Facts
from modalmotion.tracking import Track, track
from modalmotion.tracking.hdf5 import track_from_hdf5, track_to_hdf5


@pytest.fixture(scope="module")
def result() -> Track:
    beat, rng = breathing_spheroid(4), np.random.default_rng(0)
    clouds: list[object] = [sampled(x, beat.faces, 150, rng, 0.3) for x in beat.vertices]
    clouds[2] = None
    times = [0.0, 0.2, 0.5, 0.7]
    return track(clouds, modes=7, times=times, facts=Facts(period=0.9), unit="mm")


def test_a_track_reads_as_it_was_written(result: Track) -> None:
    data = track_to_hdf5(result)
    assert data == track_to_hdf5(result)
    again = track_from_hdf5(data)
    assert track_to_hdf5(again) == data
    assert again.sequence.id == result.sequence.id
    assert again.sequence.facts == result.sequence.facts
    assert again.template.id == result.template.id
    assert again.modes == result.modes
    for name in ("prior", "noise", "unseen", "reference", "notes"):
        assert getattr(again, name) == getattr(result, name)
    assert again.data is not None
    assert result.data is not None
    assert again.data.n_points == 450
    for name in ("points", "weights", "are_landmarks", "counts"):
        assert np.array_equal(getattr(again.data, name), getattr(result.data, name)), name
    for name in ("amplitudes", "covariances", "deviations", "residuals", "volumes", "determined"):
        assert np.array_equal(getattr(again, name), getattr(result, name), equal_nan=True)


def test_every_dataset_says_its_unit_and_axes(result: Track) -> None:
    with h5py.File(io.BytesIO(track_to_hdf5(result))) as file:
        assert file.attrs["schema"] == b"modalmotion.track"
        assert file["deviations"].attrs["unit"] == b"mm"
        assert file["covariances"].attrs["unit"] == b"mm^2"
        for dataset in file.values():
            assert "unit" in dataset.attrs


def test_points_that_do_not_add_up_are_refused(result: Track) -> None:
    assert result.data is not None
    wrong = replace(result.data, counts=result.data.counts + 1)
    with pytest.raises(CorruptFileError, match="454 points, and there are 450"):
        track_from_hdf5(track_to_hdf5(replace(result, data=wrong)))
    without = track_from_hdf5(track_to_hdf5(replace(result, data=None)))
    assert without.data is None


def test_an_altered_file_is_refused(result: Track) -> None:
    data = bytearray(track_to_hdf5(result))
    data[len(data) // 2] ^= 1
    with pytest.raises(CorruptFileError):
        track_from_hdf5(bytes(data))
