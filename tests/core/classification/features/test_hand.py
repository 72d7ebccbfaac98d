"""The image in a mirror of a signature against the signature of the image in a mirror."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modalmotion.classification.features import READINGS, FeatureReader
from modalmotion.classification.features.hand import (
    hand_of,
    mirrored,
    readings_of,
    right_handed,
    theta_is_of_the_shape,
)
from modalmotion.facts import Facts
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topology import CYLINDER
from modalmotion.signature.making import SignatureKind, SignatureParameters, modal_signature
from modalmotion.simulate import Acquisition, simulate_ventricle

MEAN_SHAPE = SignatureParameters(modes=7, reference="mean")
OFFSETS = replace(MEAN_SHAPE, kind=SignatureKind.OFFSET)


@pytest.fixture(scope="module", params=["lattice", "cylinder", "triangles"])
def beat(request: pytest.FixtureRequest) -> MeshSequence:
    made = simulate_ventricle(
        n_vertices=500 if request.param == "triangles" else None,
        acquisition=Acquisition(n_frames=16, noise=0.2),
        rng=np.random.default_rng(8),
    )
    return replace(made, topology=CYLINDER) if request.param == "cylinder" else made


@pytest.mark.every(5)
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("walls", [False, True])
@pytest.mark.parametrize("parameters", [MEAN_SHAPE, OFFSETS], ids=["material", "offset"])
def test_a_mirrored_signature_is_that_of_the_mirrored_recording(
    beat: MeshSequence, axis: int, walls: bool, parameters: SignatureParameters
) -> None:
    image = replace(beat, vertices=beat.vertices * np.where(np.arange(3) == axis, -1, 1))
    one, other = mirrored(modal_signature(beat, parameters)), modal_signature(image, parameters)
    assert readings_of(one).tolist() == readings_of(other).tolist()
    for reader in (FeatureReader(True, True, 2, walls), FeatureReader(False, True, 2, walls)):
        a, b = reader.read(one).values, reader.read(other).values
        if reader.has_axis:
            allowed = readings_of(one)
            a, b = a[allowed], b[allowed]
        assert np.allclose(a, b, atol=1e-8 * np.abs(a).max())


def test_the_shape_says_which_way_theta_runs(beat: MeshSequence) -> None:
    signature = modal_signature(beat, MEAN_SHAPE)
    allowed = readings_of(signature)
    assert [READINGS[k].is_mirrored for k in np.flatnonzero(allowed)] == [False, False]
    if beat.grid is None:
        assert theta_is_of_the_shape(signature)
        return
    # Columns the other way round.
    columns = beat.vertices.reshape(beat.n_frames, *beat.grid, 3)[:, :, ::-1]
    turned = replace(beat, vertices=columns.reshape(beat.vertices.shape))
    allowed = readings_of(modal_signature(turned, MEAN_SHAPE))
    assert [READINGS[k].is_mirrored for k in np.flatnonzero(allowed)] == [True, True]
    assert readings_of(replace(signature, landmarks=None)).all()


def test_facts_say_which_hand(beat: MeshSequence) -> None:
    signature = modal_signature(beat, MEAN_SHAPE)
    assert hand_of(signature.facts) == "right"
    assert hand_of(Facts(coordinates="LPS")) == "right"
    assert hand_of(Facts()) == "unknown"
    assert right_handed(signature) is signature
    left = mirrored(signature)
    assert hand_of(left.facts) == "left"
    again = right_handed(left)
    assert np.array_equal(again.amplitudes, signature.amplitudes)
    assert np.array_equal(again.reference_amplitudes, signature.reference_amplitudes)
    assert again.facts.period == signature.facts.period
