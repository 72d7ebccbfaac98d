"""Features beside the motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from modalmotion.classification.features import (
    FeatureReader,
    Further,
    covariate_columns,
    has_volume,
    motion_of,
)
from modalmotion.facts import Facts
from modalmotion.mesh.sequence import MEAN, MeshSequence, mesh_sequence
from modalmotion.signature.first_modes import first_modes, whole_count
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.simulate import VentricleParameters, simulate_ventricle

PARAMETERS = SignatureParameters(modes=18, reference=MEAN, volumes=True)
BEAT = simulate_ventricle()


def of(sequence: MeshSequence) -> ModalSignature:
    return modal_signature(sequence, PARAMETERS)


def read(signature: ModalSignature, *kinds: Further, is_cycle: bool = True) -> NDArray[np.float64]:
    reader = FeatureReader(False, is_cycle, 2, False, reads_motion=False, further=kinds)
    found = reader.read(signature)
    assert len(found.columns) == found.values.shape[1]
    assert len(set(found.names)) == len(found.names)
    values: NDArray[np.float64] = found.values[0]
    return values


def moved(sequence: MeshSequence, scale: float = 1.0) -> MeshSequence:
    R = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    vertices = scale * (sequence.vertices @ R.T) + [30.0, -20.0, 500.0]
    return mesh_sequence(vertices, grid=sequence.grid, topology=sequence.topology, unit="mm")


def test_the_rest_shape_has_no_pose_and_no_size() -> None:
    shape = read(of(BEAT), Further.REST_SHAPE)
    assert read(of(moved(BEAT, 2.5)), Further.REST_SHAPE) == pytest.approx(shape, abs=1e-6)
    longer = simulate_ventricle(replace(VentricleParameters(), length=120.0))
    assert np.abs(read(of(longer), Further.REST_SHAPE) - shape).max() > 0.02


def test_the_size_is_in_mm_whatever_the_unit() -> None:
    (size,) = read(of(BEAT), Further.SIZE)
    (larger,) = read(of(moved(BEAT, 2.0)), Further.SIZE)
    assert larger - size == pytest.approx(np.log(2.0), abs=1e-9)
    in_cm = mesh_sequence(BEAT.vertices / 10.0, grid=BEAT.grid, topology=BEAT.topology, unit="cm")
    assert read(of(in_cm), Further.SIZE)[0] == pytest.approx(size, abs=1e-9)


def test_the_volume_is_read_as_lengths_and_a_share() -> None:
    signature = of(BEAT)
    assert signature.volumes is not None
    largest, share = read(signature, Further.VOLUME)
    assert np.exp(3.0 * largest) == pytest.approx(signature.volumes.max())
    assert share == pytest.approx(1.0 - signature.volumes.min() / signature.volumes.max())


def test_the_volume_curve_does_not_hang_on_the_start_of_a_cycle() -> None:
    curve = read(of(BEAT), Further.VOLUME_CURVE)
    later = replace(BEAT, vertices=np.roll(BEAT.vertices.astype(np.float64), 7, axis=0))
    assert read(of(later), Further.VOLUME_CURVE) == pytest.approx(curve, abs=1e-9)
    course = read(of(later), Further.VOLUME_CURVE, is_cycle=False)
    before = read(of(BEAT), Further.VOLUME_CURVE, is_cycle=False)
    assert np.abs(course - before).max() > 0.01


def test_a_volume_that_turns_inside_out_is_none() -> None:
    signature = of(BEAT)
    assert has_volume(signature)
    assert signature.volumes is not None
    assert not has_volume(replace(signature, volumes=-signature.volumes))
    assert not has_volume(replace(signature, volumes=None))


def test_covariates_are_numbers_words_and_gaps() -> None:
    known: list[dict[str, float | str]] = [
        {"age": 50.0, "sex": "f", "site": "a"},
        {"age": 70.0, "sex": "m", "site": "a"},
        {"sex": "m", "site": "a"},
    ]
    columns = covariate_columns(known)
    # A site that is the same in all says nothing.
    assert [column.name for column in columns] == ["age", "sex"]
    reader = FeatureReader(
        *(False, True, 2, False),
        reads_motion=False,
        further=(Further.COVARIATES,),
        covariates=columns,
    )
    signature = of(BEAT)
    cases: list[tuple[dict[str, float | str], list[float]]] = [
        ({"age": 50.0, "sex": "f"}, [50.0, 0.0, 1.0, 0.0]),
        ({"sex": "m"}, [60.0, 1.0, 0.0, 1.0]),
        # A word that was never seen is none of those.
        ({"age": 70.0, "sex": "x"}, [70.0, 0.0, 0.0, 0.0]),
    ]
    for stated, expected in cases:
        found = reader.read(replace(signature, facts=Facts(covariates=stated)))
        assert found.values[0].tolist() == expected
        assert len(found.columns) == 4


def test_the_first_modes_are_those_of_the_fit_of_all() -> None:
    signature = of(BEAT)
    n = whole_count(signature.modes, 8)
    assert n in (8, 9)
    few = first_modes(signature, n)
    assert few.modes == signature.modes.take(np.arange(n))
    assert np.array_equal(few.amplitudes, signature.amplitudes[:, :n])
    assert len(few.reference_amplitudes) == len(few.angular_frequencies) == n
    assert first_modes(few, n) is few
    plain = FeatureReader(False, True, 2, False)
    part = motion_of(few, plain).terms
    assert part == pytest.approx(motion_of(signature, plain).terms[:, :n], rel=1e-12)
    # A reader of the first modes reads them out of more.
    found = replace(plain, n_modes=n).read(signature).values
    # Roots of what is not there are those of rounding.
    assert found == pytest.approx(plain.read(few).values, abs=1e-7)


def test_further_features_stand_beside_the_motion() -> None:
    signature = of(BEAT)
    axis = FeatureReader(True, True, 2, False, n_modes=7)
    both = replace(axis, further=(Further.SIZE, Further.VOLUME))
    motion, found = axis.read(signature), both.read(signature)
    assert found.values.shape == (4, motion.values.shape[1] + 3)
    assert np.array_equal(found.values[:, :-3], motion.values)
    assert all(column.modes == () for column in found.columns[-3:])
    assert "size, volume" in both.description
