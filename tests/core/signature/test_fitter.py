"""One sequence on one template, centred once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from template_surfaces import Moving, make_ventricle

import modalmotion.signature.fit as fitter_module
from modalmotion.mesh.alignment import Displacements, displacements_from
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.signature.fit import Fitter, make_basis
from modalmotion.signature.making import modal_signature
from modalmotion.signature.parameters import SignatureParameters
from modalmotion.template import choose_modes, make_template
from modalmotion.template.body_frame import Components


@pytest.fixture(scope="module", name="heart")
def _heart() -> Moving:
    return make_ventricle(400, np.random.default_rng(0))


@pytest.mark.parametrize("remove_rotation", [True, False])
@pytest.mark.parametrize("components", list(Components))
def test_other_parameters_are_as_if_asked_at_first(
    heart: Moving, components: Components, remove_rotation: bool
) -> None:
    sequence = mesh_sequence(*heart)
    template = make_template(sequence)
    basis = make_basis(template, choose_modes(template, 7)[0])
    asked = SignatureParameters(components=components, remove_rotation=remove_rotation)
    one = Fitter.of(sequence, template, asked).fit(basis)
    other = Fitter.of(sequence, template).asking(
        components=components, remove_rotation=remove_rotation
    )
    assert other.parameters == asked
    assert (other.fit(basis).amplitudes == one.amplitudes).all()
    assert (other.fit(basis).rotations.matrices == one.rotations.matrices).all()


@pytest.mark.parametrize(
    "way", [{}, pytest.param({"auto": True}, marks=pytest.mark.soak), {"tolerance": 3.0}]
)
def test_a_signature_centres_its_sequence_once(
    heart: Moving, way: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    n_centred, centre = [], displacements_from

    def counted(*arguments: Any, **options: Any) -> Displacements:
        n_centred.append(1)
        return centre(*arguments, **options)

    monkeypatch.setattr(fitter_module, "displacements_from", counted)
    modal_signature(mesh_sequence(*heart, unit="mm"), SignatureParameters(**way))  # type: ignore[arg-type]
    assert len(n_centred) == 1
