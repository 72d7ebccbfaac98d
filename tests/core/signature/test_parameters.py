"""What a signature is asked for: pairs of cosine and sine, whole or split."""

from __future__ import annotations

import numpy as np
import pytest
from template_surfaces import Moving, make_tube, make_ventricle

from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topology import CUP, CYLINDER
from modalmotion.signature.making import modal_signature
from modalmotion.signature.parameters import (
    SignatureParameters,
    parameters_as_json,
    parameters_from_json,
)
from modalmotion.signature.value import ModalSignature
from modalmotion.template import choose_modes, make_template

SPLIT = SignatureParameters(amplitudes=51, split_pairs=True)


def tube_of(n_axial: int, n_around: int) -> MeshSequence:
    """Lattice that beats and bends, as a cylinder."""
    s, theta = np.meshgrid(
        np.linspace(0, 1, n_axial), 2 * np.pi * np.arange(n_around) / n_around, indexing="ij"
    )
    frames = []
    for k in range(3):
        radius = 20.0 - k * (1 + s) * (1 + 0.2 * np.cos(theta))
        along = 60 * s + k * np.exp(-3 * s) * np.exp(2 * np.cos(theta - 0.4))
        x = np.stack([radius * np.cos(theta), radius * np.sin(theta), along], axis=-1)
        frames.append(x.reshape(-1, 3))
    return mesh_sequence(np.stack(frames), grid=(n_axial, n_around), topology="cylinder")


def notes_on_pairs(signature: ModalSignature) -> list[str]:
    return [note for note in signature.notes if "pair" in note or "without its sine" in note]


@pytest.mark.parametrize(("make", "topology"), [(make_ventricle, CUP), (make_tube, CYLINDER)])
def test_51_amplitudes_are_given_exactly_where_a_pair_may_be_split(make, topology) -> None:  # type: ignore[no-untyped-def]
    moving: Moving = make(400, np.random.default_rng(0))
    sequence = mesh_sequence(*moving)
    whole = modal_signature(sequence, SignatureParameters(amplitudes=51))
    split = modal_signature(sequence, SPLIT)
    assert whole.topology == split.topology == topology
    assert 3 * len(split.modes) == 51
    assert split.amplitudes.shape[1] == 17
    assert 3 * len(whole.modes) == 54
    assert split.modes.labels == whole.modes.labels[:17]
    assert "54 amplitudes" in notes_on_pairs(whole)[0]
    assert "where theta is zero" in notes_on_pairs(split)[0]
    assert whole.rms_error < split.rms_error


@pytest.mark.parametrize(
    ("amplitudes", "n_modes", "compression"), [(3, 1, 4000), (21, 7, 571), (51, 17, 235)]
)
def test_compressions_of_the_paper(amplitudes: int, n_modes: int, compression: int) -> None:
    sequence = tube_of(50, 80)
    asked = SignatureParameters(amplitudes=amplitudes, split_pairs=True)
    signature = modal_signature(sequence, asked)
    assert sequence.n_vertices == 4000
    assert len(signature.modes) == n_modes
    assert int(signature.compression) == compression


def test_a_whole_number_of_pairs_is_the_same_with_and_without() -> None:
    sequence = tube_of(10, 12)
    one = modal_signature(sequence, SignatureParameters(modes=7))
    other = modal_signature(sequence, SignatureParameters(modes=7, split_pairs=True))
    assert (one.amplitudes == other.amplitudes).all()
    assert one.notes == other.notes


def test_another_zero_of_theta_moves_the_split_pair_and_no_other() -> None:
    # The same tube, its nodes numbered from the next one on.
    sequence = tube_of(10, 12)
    rolled = np.roll(sequence.vertices.reshape(3, 10, 12, 3), -1, axis=2).reshape(3, 120, 3)
    other = mesh_sequence(rolled, grid=(10, 12), topology="cylinder")
    one, two = (modal_signature(x, SPLIT) for x in (sequence, other))
    # Of a cosine and its sine together the length stays, of a lone cosine it does not.
    energy = [(s.amplitudes**2).sum(axis=(0, 2)) for s in (one, two)]
    # Areas are not quite even around, so that a lone cosine takes a little from each mode.
    assert energy[0][0] == pytest.approx(energy[1][0], rel=2e-3)
    assert energy[0][-1] != pytest.approx(energy[1][-1], rel=0.5)


def test_the_key_of_whole_pairs_is_what_it_was() -> None:
    assert SPLIT.key != SignatureParameters(amplitudes=51).key
    assert parameters_from_json(parameters_as_json(SPLIT)) == SPLIT


@pytest.mark.parametrize("way", [{"tolerance": 1.0}, {"auto": True}])
def test_what_follows_from_the_data_takes_whole_pairs(way: dict[str, float]) -> None:
    with pytest.raises(ParameterError, match="whole pairs"):
        SignatureParameters(split_pairs=True, **way)  # type: ignore[arg-type]


def test_kept_modes_are_told_apart_by_it() -> None:
    sequence = tube_of(10, 12)
    template = make_template(sequence)
    assert len(choose_modes(template, 17, (10, 12)).modes) == 18
    assert len(choose_modes(template, 17, (10, 12), split_pairs=True).modes) == 17
