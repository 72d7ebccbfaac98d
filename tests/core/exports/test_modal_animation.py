"""Signatures as animations of morph targets."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.errors import ParameterError
from modalmotion.exports.animation import modal_animation
from modalmotion.formats import read_sequence, write_glb
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topologies import CYLINDER
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import at_times, reconstruct

SHAPE = (9, 16)


@pytest.fixture(scope="module")
def beating() -> MeshSequence:
    """A tube that contracts, twists, turns and moves away."""
    s, theta = np.meshgrid(
        (np.arange(SHAPE[0]) + 0.5) / SHAPE[0], np.arange(SHAPE[1]) / SHAPE[1], indexing="ij"
    )
    frames = []
    for t in np.linspace(0.0, 1.0, 6):
        radius = 20.0 - 6.0 * np.sin(np.pi * t) * (1 + 0.3 * np.cos(4 * np.pi * theta)) * s
        angle = 2 * np.pi * theta + 0.3 * t * s + 0.5 * t
        x, y, z = radius * np.cos(angle) + 5 * t, radius * np.sin(angle), 60 * s - 9 * t
        frames.append(np.stack([x, y, z], axis=-1).reshape(-1, 3))
    return mesh_sequence(
        np.array(frames), grid=SHAPE, topology=CYLINDER, times=np.arange(6) / 5, unit="mm"
    )


@pytest.fixture(scope="module")
def signature(beating: MeshSequence) -> ModalSignature:
    return modal_signature(beating, SignatureParameters(modes=7))


def test_it_plays_what_is_reconstructed(beating: MeshSequence, signature: ModalSignature) -> None:
    animation = modal_animation(signature, beating)
    expected = reconstruct(signature, beating)
    largest = float(np.abs(expected).max())
    # Shapes are kept as float32, and as many of them add up as there are targets.
    tolerance = len(animation.targets) * largest * float(np.finfo(np.float32).eps)
    assert np.abs(animation.positions() - expected).max() < tolerance
    assert animation.n_left_out == 0
    read = read_sequence(write_glb(animation)).sequence
    assert np.abs(read.vertices - expected).max() < tolerance
    assert read.unit == "mm"
    assert read.grid == SHAPE
    assert read.times is not None
    assert np.abs(read.times - np.arange(6) / 5).max() < 1e-7


def test_targets_come_by_how_much_they_move(
    beating: MeshSequence, signature: ModalSignature
) -> None:
    animation = modal_animation(signature, beating)
    moved = animation.weights[:, :, None, None] * animation.targets
    energies = (moved**2).sum(axis=3).mean(axis=(0, 2))
    assert (np.diff(energies) <= 1e-6 * energies[0]).all()
    # The mean translation moves the mesh as a whole and is no target.
    assert not any(name.startswith("(0, 0, cos)") for name in animation.target_names)
    assert len(set(animation.target_names)) == len(animation.target_names) == 18


@pytest.mark.parametrize("max_targets", [0, 1, 5, 99])
def test_what_is_left_out_is_counted_and_measured(
    max_targets: int, beating: MeshSequence, signature: ModalSignature
) -> None:
    whole = modal_animation(signature, beating)
    some = modal_animation(signature, beating, max_targets)
    n = min(max_targets, len(whole.targets))
    assert len(some.targets) == n
    assert some.target_names == whole.target_names[:n]
    assert some.n_left_out == len(whole.targets) - n
    lost = np.sqrt(((some.positions() - whole.positions()) ** 2).sum(axis=2).mean())
    # A lattice's areas differ from node to node; the measure is over the surface.
    assert some.rms_left_out == pytest.approx(lost, rel=0.2, abs=1e-9)


def test_a_resampled_signature_plays_at_its_own_times(
    beating: MeshSequence, signature: ModalSignature
) -> None:
    times = np.array([0.1, 0.5])
    animation = modal_animation(at_times(signature, times), beating)
    assert len(animation.weights) == 2
    read = read_sequence(write_glb(animation)).sequence
    assert read.times is not None
    assert np.allclose(read.times, times)


def test_another_sequence_is_refused(beating: MeshSequence, signature: ModalSignature) -> None:
    with pytest.raises(ParameterError, match="another sequence"):
        modal_animation(signature, beating.with_unit("cm"))
    with pytest.raises(ParameterError, match="-1 targets"):
        modal_animation(signature, beating, -1)
