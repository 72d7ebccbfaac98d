"""Features of offsets: independent of pose, size, start and hand; they see no sliding points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modalmotion.classification.features import READINGS, FeatureReader
from modalmotion.classification.features.columns import MotionFeatures
from modalmotion.errors import ModeCountError
from modalmotion.mesh.sequence import MEAN, MeshSequence
from modalmotion.modes.topology import CYLINDER
from modalmotion.signature.making import SignatureKind, SignatureParameters, modal_signature
from modalmotion.simulate import Acquisition, VentricleParameters, simulate_ventricle

GRID = (16, 32)
READER = FeatureReader(True, True, 2, False)
PARAMETERS = SignatureParameters(kind=SignatureKind.OFFSET, reference=MEAN)


def beat(**acquisition: object) -> MeshSequence:
    return simulate_ventricle(
        VentricleParameters(shape_variation=1.0, motion_variation=1.0),
        grid=GRID,
        acquisition=Acquisition(n_frames=16, **acquisition),  # type: ignore[arg-type]
        rng=np.random.default_rng(4),
    )


BEAT = beat()


def read(sequence: MeshSequence, modes: int = 7, reader: FeatureReader = READER) -> MotionFeatures:
    return reader.read(modal_signature(sequence, replace(PARAMETERS, modes=modes)))


def rolled(sequence: MeshSequence, columns: int) -> MeshSequence:
    x = np.roll(sequence.vertices.astype(np.float64).reshape(-1, *GRID, 3), columns, axis=2)
    return replace(sequence, vertices=x.reshape(-1, GRID[0] * GRID[1], 3))


@pytest.mark.parametrize("modes", [7, 16])
def test_each_value_has_a_name_and_narrowing_comes_first(modes: int) -> None:
    features = read(BEAT, modes)
    assert features.values.shape == (len(READINGS), len(set(features.names)))
    named = dict(zip(features.names, features.values[0].tolist(), strict=True))
    assert named["radial 0 cos 1"] < -1.0
    assert abs(named["radial 0 cos 1"]) == max(map(abs, named.values()))
    assert not [name for name in named if "turning" in name]


@pytest.mark.every(2)
@pytest.mark.parametrize(
    "other",
    [
        rolled(BEAT, 9),
        replace(BEAT, vertices=BEAT.vertices / 1000.0, unit="m"),
        replace(BEAT, vertices=BEAT.vertices[:, :, [1, 2, 0]] + 100.0),
        beat(start_phase=0.3),
    ],
    ids=["start angle", "unit", "pose", "start of the beat"],
)
def test_features_do_not_depend_on_how_it_was_recorded(other: MeshSequence) -> None:
    powers = np.array([1.0 / column.power for column in read(BEAT).columns])
    # In percent of the size: roots of what hardly moves are sensitive.
    own, others = (np.abs(read(one).values) ** powers for one in (BEAT, other))
    np.testing.assert_allclose(others, own, atol=0.08)


def test_a_cup_and_the_cylinder_that_some_state_have_the_same_columns() -> None:
    for modes in (7, 16):
        cup, cylinder = read(BEAT, modes), read(replace(BEAT, topology=CYLINDER), modes)
        assert cup.names == cylinder.names


def test_the_other_hand_turns_walls_across_zero_alone() -> None:
    features = read(BEAT, reader=replace(READER, walls=True))
    own, other = features.values[0], features.values[-1]
    is_across = np.array(["across zero" in name for name in features.names])
    np.testing.assert_array_equal(own[is_across], -other[is_across])
    np.testing.assert_array_equal(own[~is_across], other[~is_across])
    assert is_across.any()
    np.testing.assert_array_equal(*read(BEAT).values[[0, -1]])


def test_too_few_modes_are_refused() -> None:
    with pytest.raises(ModeCountError):
        read(BEAT, modes=1)


def test_modes_of_offsets_are_read_as_they_are_with_one_direction() -> None:
    signature = modal_signature(BEAT, PARAMETERS)
    terms = np.zeros((2, 7, 1), dtype=np.complex128)
    for reader in (
        FeatureReader(False, True, 2, False),
        FeatureReader(False, True, 2, False, is_brief=True),
        FeatureReader(False, False, 2, True, typical=np.zeros((4, 7, 1), dtype=np.complex128)),
        FeatureReader(False, True, 2, False, typical=terms + 1.0),
    ):
        features = reader.read(signature)
        assert features.values.shape == (1, len(features.columns))
        assert np.isfinite(features.values).all()
