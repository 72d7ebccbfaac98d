"""Shape and volume that a signature keeps beside the motion."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.clinical.readouts import clinical_readouts
from modalmotion.mesh.alignment import reference_positions
from modalmotion.mesh.sequence import MEAN, mesh_sequence
from modalmotion.modes.topologies import CYLINDER
from modalmotion.signature.fit import make_basis, project
from modalmotion.signature.making import (
    SignatureParameters,
    enclosed_volumes,
    modal_signature,
    resolve_parameters,
    resolve_template,
)
from modalmotion.simulate import simulate_ventricle
from modalmotion.template.body_frame import Components

BEAT = simulate_ventricle()
VOLUMES = SignatureParameters(volumes=True)


def test_volumes_are_those_of_the_vertices() -> None:
    signature = modal_signature(BEAT, VOLUMES)
    assert signature.volumes is not None
    readouts = clinical_readouts(signature, BEAT)
    assert signature.volumes == pytest.approx(readouts.mesh_curve.volumes, rel=1e-12)
    # They are kept where they were requested, and the rest of the signature is the same.
    plain = modal_signature(BEAT)
    assert plain.volumes is None
    assert plain.amplitudes == pytest.approx(signature.amplitudes, abs=0.0)
    assert plain.parameters.key != signature.parameters.key


def test_the_reference_has_amplitudes_of_its_own() -> None:
    for reference in (0, 3, MEAN):
        parameters = SignatureParameters(modes=18, reference=reference)
        signature = modal_signature(BEAT, parameters)
        template = resolve_template(BEAT, resolve_parameters(BEAT, parameters))
        shape = reference_positions(BEAT, reference)
        shape = shape - np.average(shape, axis=0, weights=template.weights)
        expected = project(make_basis(template, signature.modes), shape[None])[0]
        assert signature.reference_amplitudes == pytest.approx(expected, abs=1e-9)
        assert np.abs(expected).max() > 10.0


def test_cylindrical_components_have_no_shape() -> None:
    parameters = SignatureParameters(components=Components.CYLINDRICAL)
    assert not modal_signature(BEAT, parameters).reference_amplitudes.any()


def test_what_encloses_nothing_has_no_volume(rng: np.random.Generator) -> None:
    sheet = mesh_sequence(rng.normal(size=(3, 20, 3)), grid=(4, 5), topology="plane")
    assert modal_signature(sheet, VOLUMES).volumes is None
    # Beyond the largest number there is none either.
    huge = mesh_sequence(BEAT.vertices * 1e110, grid=BEAT.grid, topology=CYLINDER)
    assert enclosed_volumes(huge, resolve_template(huge, VOLUMES)) is None


def test_either_winding_gives_a_positive_volume() -> None:
    surface = mesh_sequence(BEAT.vertices, np.ascontiguousarray(BEAT.faces[:, ::-1]))
    volumes = modal_signature(surface, VOLUMES).volumes
    assert volumes is not None
    assert (volumes > 0).all()
    assert volumes == pytest.approx(modal_signature(BEAT, VOLUMES).volumes, rel=1e-9)
