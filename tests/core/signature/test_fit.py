"""The fit against its slow twin, and the laws it keeps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from slow_fits import assert_same, slow_fit
from template_surfaces import Moving, describe, fit_sequence, make_tube, make_ventricle

import modalmotion.mesh.alignment as displacements_module
from modalmotion.errors import TopologyError
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.signature.fit import Fitter, make_basis, project
from modalmotion.template import choose_modes, make_template
from modalmotion.template.body_frame import Components, from_local, local_frames


@pytest.fixture(scope="module", name="heart")
def _heart() -> Moving:
    vertices, faces = make_ventricle(400, np.random.default_rng(0))
    # Turned as a whole, so that there is a rotation to find.
    turns = Rotation.from_rotvec(np.outer(np.linspace(0, 2, len(vertices)), [0.3, 1.0, -0.2]))
    return np.einsum("fij,fnj->fni", turns.as_matrix(), vertices), faces


@pytest.mark.every(3)
@pytest.mark.parametrize("components", list(Components))
@pytest.mark.parametrize("remove_rotation", [True, False])
@pytest.mark.parametrize("n_modes", [1, 7, 18])
def test_against_the_slow_twin(
    heart: Moving, components: Components, remove_rotation: bool, n_modes: int
) -> None:
    sequence = mesh_sequence(*heart)
    template = make_template(sequence)
    basis = make_basis(template, choose_modes(template, n_modes)[0])
    fit = fit_sequence(
        sequence, template, basis, remove_rotation=remove_rotation, components=components
    )
    frames = local_frames(template) if components == Components.CYLINDRICAL else None
    slow = slow_fit(
        heart[0], template, basis.shapes, remove_rotation=remove_rotation, frames=frames
    )
    assert_same(fit, slow)


@pytest.mark.parametrize("closed_form", [True, False])
def test_spring_modes_are_fitted_alike(heart: Moving, closed_form: bool) -> None:
    sequence = mesh_sequence(*heart)
    template = make_template(sequence, closed_form=closed_form)
    basis = make_basis(template, choose_modes(template, 12)[0])
    fit = fit_sequence(sequence, template, basis)
    assert_same(fit, slow_fit(heart[0], template, basis.shapes, remove_rotation=True))


@pytest.mark.parametrize("block", [1, 3 * 400 * 5, 10**9])
def test_blocks_do_not_matter(heart: Moving, block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = describe(heart).fit
    monkeypatch.setattr(displacements_module, "_BLOCK", block)
    part = describe(heart).fit
    assert part.amplitudes == pytest.approx(whole.amplitudes, abs=1e-12)
    assert part.errors.rms == pytest.approx(whole.errors.rms, abs=1e-12)


def test_displacements_are_those_that_are_fitted(heart: Moving) -> None:
    found = describe(heart)
    w = found.template.weights
    parts = list(Fitter.of(found.sequence, found.template).displacements.blocks())
    u = np.concatenate([part.u * part.shape.scale for part in parts]).transpose(0, 2, 1)
    assert u.shape == heart[0].shape
    basis = make_basis(found.template, choose_modes(found.template, 7)[0])
    a = found.fit.amplitudes
    for layout in (u, np.ascontiguousarray(u), np.asfortranarray(u)):
        assert project(basis, layout) == pytest.approx(a, abs=1e-11)
    assert basis.projector @ u == pytest.approx(a, abs=1e-11)
    rms = np.sqrt((u**2).sum(axis=2) @ w)
    assert found.fit.motion.weighted_rms == pytest.approx(rms, abs=1e-12)


def test_what_was_superposed_is_found(heart: Moving) -> None:
    vertices, faces = heart
    template = make_template(mesh_sequence(vertices, faces))
    basis = make_basis(template, choose_modes(template, 37)[0])
    a = np.random.default_rng(1).normal(size=(3, 37, 3)) * 0.5
    a[0] = 0.0
    moved = vertices[0] + np.einsum("nm,fmd->fnd", basis.shapes, a)
    fit = fit_sequence(mesh_sequence(moved, faces), template, basis, remove_rotation=False)
    assert fit.amplitudes == pytest.approx(a, abs=1e-12)
    assert fit.errors.max.max() <= 1e-12
    assert (fit.amplitudes[0] == 0).all()


def test_energy_is_that_of_the_gram_matrix(heart: Moving) -> None:
    found = describe(heart, 18)
    w = found.template.weights
    basis = make_basis(found.template, choose_modes(found.template, 18)[0])
    G = basis.shapes.T @ (w[:, None] * basis.shapes)
    assert basis.triangle.T @ basis.triangle == pytest.approx(G, abs=1e-12)
    a = found.fit.amplitudes
    superposed = np.einsum("fmd,mk,fkd->f", a, G, a)
    assert found.fit.motion.weighted_rms**2 == pytest.approx(
        superposed + found.fit.errors.weighted_rms**2
    )
    assert basis.projector @ basis.shapes == pytest.approx(np.eye(18), abs=1e-12)


def test_float32_is_taken_at_its_word(heart: Moving) -> None:
    vertices, faces = heart
    narrow = vertices.astype(np.float32)
    wide = describe((narrow.astype(np.float64), faces))
    template = wide.template
    basis = make_basis(template, choose_modes(template, 7)[0])
    fit = fit_sequence(mesh_sequence(narrow, faces), template, basis)
    assert (fit.amplitudes == wide.fit.amplitudes).all()
    assert (fit.errors.weighted_rms == wide.fit.errors.weighted_rms).all()


def test_the_same_bits_over_runs(heart: Moving) -> None:
    one, other = describe(heart, 18), describe(heart, 18)
    assert (one.fit.amplitudes == other.fit.amplitudes).all()
    assert (one.template.coordinates == other.template.coordinates).all()
    assert one.template.lengths == other.template.lengths


def test_components_read_as_contraction_twist_and_shortening() -> None:
    rng = np.random.default_rng(0)
    vertices, faces = make_tube(800, rng)
    start = vertices[0]
    template = make_template(mesh_sequence(start[None], faces))
    landmarks = template.landmarks
    assert landmarks is not None
    frames = local_frames(template)
    assert np.einsum("nij,nkj->nik", frames, frames) == pytest.approx(
        np.broadcast_to(np.eye(3), frames.shape), abs=1e-12
    )
    assert np.linalg.det(frames) == pytest.approx(1.0)
    radial, tangential, axial = frames.transpose(1, 0, 2)
    moved = np.stack([start, start - 2 * radial, start + 0.5 * tangential, start - 3 * axial])
    sequence = mesh_sequence(moved, faces)
    basis = make_basis(template, choose_modes(template, 1)[0])
    fit = fit_sequence(
        sequence, template, basis, components=Components.CYLINDRICAL, remove_rotation=False
    )
    expected = np.zeros((4, 1, 3))
    expected[1, 0, 0], expected[2, 0, 1], expected[3, 0, 2] = -2, 0.5, -3
    assert fit.amplitudes == pytest.approx(expected, abs=1e-12)
    assert fit.errors.max.max() <= 1e-12
    u = from_local(np.broadcast_to(expected, (4, len(start), 3)), frames)
    assert start + u == pytest.approx(moved, abs=1e-12)


def test_components_need_an_axis(heart: Moving) -> None:
    sequence = mesh_sequence(*heart)
    template = make_template(sequence, closed_form=False)
    basis = make_basis(template, choose_modes(template, 3)[0])
    with pytest.raises(TopologyError, match="no axis"):
        fit_sequence(sequence, template, basis, components=Components.CYLINDRICAL)
