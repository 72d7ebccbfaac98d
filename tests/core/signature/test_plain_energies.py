"""Errors of nested sets where all vertices count alike, against fits of each set by itself."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.signature import measure_front
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion.template.body_frame import Components


@pytest.fixture(scope="module")
def beat() -> MeshSequence:
    made = simulate_ventricle(
        n_vertices=200,
        acquisition=Acquisition(n_frames=9, noise=0.4),
        rng=np.random.default_rng(8),
    )
    x = np.asarray(made.vertices)
    loose = np.full((9, 2, 3), 3.0) + np.arange(9)[:, None, None]
    return mesh_sequence(np.concatenate([x, loose], axis=1), made.faces, unit="mm")


@pytest.mark.every(2)
@pytest.mark.parametrize("components", Components)
@pytest.mark.parametrize("harmonics", [None, 0, 2])
def test_every_set_leaves_what_its_own_fit_leaves(
    beat: MeshSequence, components: Components, harmonics: int | None
) -> None:
    asked = SignatureParameters(components=components, topology="cup")
    branch = measure_front(beat, asked, most_modes=24, components=(components,)).branches[0]
    for k, count in enumerate(branch.counts.tolist()):
        own = SignatureParameters(
            modes=count, components=components, topology="cup", harmonics=harmonics
        )
        signature = modal_signature(beat, own)
        plain, weighted = branch.rms[k], branch.weighted_rms[k]
        if harmonics is not None:
            plain = branch.joint_rms[k, harmonics]
            weighted = branch.weighted_joint_rms[k, harmonics]
        assert plain == pytest.approx(signature.rms_error, rel=1e-10)
        assert weighted == pytest.approx(signature.weighted_rms_error, rel=1e-10)
        assert plain != pytest.approx(weighted, rel=1e-3)
