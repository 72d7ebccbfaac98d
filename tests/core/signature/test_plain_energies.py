"""Errors of nested sets where all vertices count alike, against fits of each set by itself."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topologies import CUP
from modalmotion.signature.fit import Fitter
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.signature.nested_modes import energies_of, harmonics_of, nested_modes
from modalmotion.signature.parameters import ErrorKind
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion.template import make_template
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
    cup = beat.with_topology(CUP, None)
    asked = SignatureParameters(components=components, topology="cup")
    fitter = Fitter.of(cup, make_template(cup), asked)
    nested = nested_modes(fitter.template, 24, None)
    fit, functions = fitter.fit(nested.basis), harmonics_of(9, beat.times)
    by_kind = []
    for kind in (ErrorKind.RMS, ErrorKind.WEIGHTED_RMS):
        energies = energies_of(fitter, fit, kind)
        joint = energies.joint_rms(nested.counts, functions)
        by_kind.append(energies.rms(nested.counts) if harmonics is None else joint[:, harmonics])
    for count, plain, weighted in zip(nested.counts.tolist(), *by_kind, strict=True):
        own = SignatureParameters(
            modes=count, components=components, topology="cup", harmonics=harmonics
        )
        signature = modal_signature(beat, own)
        assert plain == pytest.approx(signature.rms_error, rel=1e-10)
        assert weighted == pytest.approx(signature.weighted_rms_error, rel=1e-10)
        assert plain != pytest.approx(weighted, rel=1e-3)
