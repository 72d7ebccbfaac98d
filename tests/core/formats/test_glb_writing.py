"""GLB animations of morph targets: written, played and read back."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from format_samples import FACES, TIMES, VERTICES, animation
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.formats import NO_LIMITS, read_sequence, write_glb
from modalmotion.formats.glb import Channel, File
from modalmotion.formats.glb_writing import MorphAnimation, to_quaternions

# Positions are float32; the base holds the least weights' share, so a few roundings add up.
SINGLE = 16 * float(np.spacing(np.float32(np.abs(VERTICES).max())))


def played(data: bytes) -> NDArray[np.float64]:
    """The simplest player of files as we write them, from the bytes on."""
    (length,) = struct.unpack_from("<I", data, 12)
    document = json.loads(data[20 : 20 + length])
    binary = data[20 + length + 8 :]

    def numbers(accessor: int) -> NDArray[np.float64]:
        view = document["bufferViews"][document["accessors"][accessor]["bufferView"]]
        start = view["byteOffset"]
        return np.frombuffer(binary[start : start + view["byteLength"]], "<f4").astype(float)

    primitive = document["meshes"][0]["primitives"][0]
    base = numbers(primitive["attributes"]["POSITION"]).reshape(-1, 3)
    targets = [numbers(t["POSITION"]).reshape(-1, 3) for t in primitive.get("targets", [])]
    moved = document["animations"][0]
    by_path = {
        c["target"]["path"]: numbers(moved["samplers"][c["sampler"]]["output"])
        for c in moved["channels"]
    }
    frames = []
    for i, turn in enumerate(Rotation.from_quat(by_path["rotation"].reshape(-1, 4))):
        weights = by_path["weights"].reshape(-1, len(targets))[i] if targets else []
        shape = base + sum(w * t for w, t in zip(weights, targets, strict=True))
        frames.append(turn.apply(shape) + by_path["translation"].reshape(-1, 3)[i])
    return np.array(frames)


@pytest.mark.parametrize("n_targets", [0, 1, 5])
def test_what_is_played_is_what_was_given(n_targets: int) -> None:
    given = animation(n_targets)
    data = write_glb(given)
    assert data == write_glb(given)
    expected = given.positions()
    assert np.abs(played(data) - expected).max() < SINGLE
    read = read_sequence(data)
    assert np.abs(read.sequence.vertices - expected).max() < SINGLE
    assert np.array_equal(read.sequence.faces, FACES)
    assert read.sequence.times is not None
    assert read.sequence.times.tolist() == list(TIMES)
    assert (read.sequence.unit, read.unit_from, read.times_from) == ("mm", "file", "file")


def test_a_second_loader_finds_the_same_bounding_box(tmp_path: Path) -> None:
    pytest.importorskip("vtkmodules", reason="needs the extra 'vtk'")
    given = animation(5)
    path = tmp_path / "surface.glb"
    path.write_bytes(write_glb(given))
    reader = import_module("vtkmodules.vtkIOGeometry").vtkGLTFReader()
    reader.SetFileName(str(path))
    reader.SetApplyDeformationsToGeometry(True)
    reader.UpdateInformation()
    assert reader.GetAnimationDuration(0) == TIMES[-1]
    reader.EnableAnimation(0)
    for time, expected in zip(TIMES, given.positions(), strict=True):
        reader.UpdateTimeStep(time)
        bounds = [0.0] * 6
        reader.GetOutputDataObject(0).GetBounds(bounds)
        assert np.abs(np.array(bounds[0::2]) - expected.min(axis=0)).max() < SINGLE
        assert np.abs(np.array(bounds[1::2]) - expected.max(axis=0)).max() < SINGLE


def test_weights_run_from_zero_to_one_and_their_ranges_are_kept() -> None:
    given = animation(2)
    container = File(write_glb(given), NO_LIMITS)
    document = container.document
    ranges = document["asset"]["extras"]["modalmotion"]["weight_ranges"]
    assert np.allclose(ranges, np.stack([given.weights.min(0), given.weights.max(0)], axis=1))
    output = document["accessors"][document["animations"][0]["samplers"][2]["output"]]
    start = document["bufferViews"][output["bufferView"]]["byteOffset"]
    weights = np.frombuffer(container.binary, "<f4", output["count"], start).reshape(-1, 2)
    assert weights.min() == 0.0
    assert weights.max() == 1.0
    assert document["meshes"][0]["extras"]["targetNames"] == ["target 0", "target 1"]


def test_frames_without_times_play_at_a_stated_rate_and_read_back_without() -> None:
    data = write_glb(replace(animation(), times=None, unit=None))
    read = read_sequence(data)
    assert read.sequence.times is None
    assert read.sequence.unit is None
    accessors = File(data, NO_LIMITS).document["accessors"]
    assert [a["max"] for a in accessors if a["type"] == "SCALAR" and "max" in a] == [
        [np.float32(2 / 25)]
    ]


def test_late_times_survive_and_times_too_close_are_refused() -> None:
    late = replace(animation(), times=np.array([1.7e9, 1.7e9 + 0.5, 1.7e9 + 1.25]))
    times = read_sequence(write_glb(late)).sequence.times
    assert times is not None
    assert times.tolist() == [1.7e9, 1.7e9 + 0.5, 1.7e9 + 1.25]
    with pytest.raises(ParameterError) as caught:
        write_glb(replace(animation(), times=np.array([0.0, 1.0, 1.0 + 1e-9])))
    assert caught.value.frame == 2


@pytest.mark.parametrize("name", ["targets", "rotations", "translations", "times"])
def test_arrays_that_do_not_fit_each_other_are_refused(name: str) -> None:
    given = animation(2)
    with pytest.raises(ShapeError, match=name):
        replace(given, **{name: getattr(given, name)[:-1]})


def test_a_contour_is_written_as_points() -> None:
    read = read_sequence(write_glb(replace(animation(), faces=FACES[:0])))
    assert not len(read.sequence.faces)


def test_rotations_survive_quaternions_at_every_angle() -> None:
    turns = Rotation.random(500, random_state=1).as_matrix()
    halves = [np.diag(d) for d in ([1, -1, -1], [-1, 1, -1], [-1, -1, 1], [1.0, 1, 1])]
    matrices = np.concatenate([turns, halves])
    quaternions = to_quaternions(matrices)
    eps = np.finfo(float).eps
    assert np.abs(Rotation.from_quat(quaternions).as_matrix() - matrices).max() < 8 * eps
    theirs = Rotation.from_matrix(matrices).as_quat()
    assert np.abs(np.abs((theirs * quaternions).sum(axis=1)) - 1).max() < 8 * eps
    assert ((quaternions[1:] * quaternions[:-1]).sum(axis=1) >= 0).all()


MOMENTS = np.array([0.0, 1.0, 1.25, 1.9, 2.0, 3.0, 4.0, 9.0])


def test_between_keys_values_are_those_of_the_specification() -> None:
    times, keys = np.array([1.0, 2.0, 4.0]), np.random.default_rng(0).normal(size=(3, 2))
    linear = Channel(times, keys).at(MOMENTS)
    for i in range(2):
        assert np.allclose(linear[:, i], np.interp(MOMENTS, times, keys[:, i]))
    step = Channel(times, keys, is_step=True).at(MOMENTS)
    assert np.array_equal(step, keys[[0, 0, 0, 0, 1, 1, 2, 2]])
    turns = Rotation.random(3, random_state=3)
    quaternions = to_quaternions(turns.as_matrix())
    turned = Channel(times, quaternions, is_rotation=True).at(MOMENTS)
    expected = Slerp(times, turns)(np.clip(MOMENTS, 1, 4)).as_matrix()
    assert np.allclose(Rotation.from_quat(turned).as_matrix(), expected, atol=1e-14)


def test_the_animation_plays_by_its_own_formula() -> None:
    given = animation(2)
    frame = 2
    u = sum(given.weights[frame, i] * given.targets[i] for i in range(2))
    expected = (given.base + u) @ given.rotations[frame].T + given.translations[frame]
    assert np.allclose(MorphAnimation.positions(given)[frame], expected, atol=1e-12)
