"""What a signature is asked for: pairs of cosine and sine, whole."""

from __future__ import annotations

import numpy as np
import pytest
from template_surfaces import Moving, make_tube, make_ventricle

from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topologies import CUP, CYLINDER
from modalmotion.signature.making import modal_signature
from modalmotion.signature.parameters import SignatureParameters
from modalmotion.signature.value import first_modes


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


@pytest.mark.parametrize(("make", "topology"), [(make_ventricle, CUP), (make_tube, CYLINDER)])
def test_51_amplitudes_become_whole_pairs(make, topology) -> None:  # type: ignore[no-untyped-def]
    moving: Moving = make(400, np.random.default_rng(0))
    whole = modal_signature(mesh_sequence(*moving), SignatureParameters(amplitudes=51))
    assert whole.topology == topology
    assert 3 * len(whole.modes) == 54
    assert any("54 amplitudes" in note for note in whole.notes)


@pytest.mark.parametrize(
    ("amplitudes", "n_modes", "compression"), [(3, 1, 4000), (21, 7, 571), (51, 17, 235)]
)
def test_compressions_of_the_paper(amplitudes: int, n_modes: int, compression: int) -> None:
    sequence = tube_of(50, 80)
    signature = first_modes(modal_signature(sequence, SignatureParameters(modes=18)), n_modes)
    assert sequence.n_vertices == 4000
    assert signature.n_amplitudes == amplitudes
    assert int(signature.compression) == compression
