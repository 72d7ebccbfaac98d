"""A surface whose vertices are doubled along seams is the surface without them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from template_surfaces import MAKERS, Moving, cut_in_two

from modalmotion.clinical import clinical_readouts
from modalmotion.errors import TopologyError
from modalmotion.mesh import connectivity_of, laplacian
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.progress import Progress
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import reconstruct
from modalmotion.template import GivenLandmarks, make_template
from modalmotion.template.body_frame import Components, vertex_normals
from modalmotion.template.template import is_merged, template_from_hdf5, template_to_hdf5


def surface(topology: str = "cup", n: int = 250) -> Moving:
    return MAKERS[topology](n, np.random.default_rng(4))


def triangle_soup(moving: Moving) -> Moving:
    """Each triangle with three vertices of its own, in the order of their first use."""
    vertices, faces = moving
    return vertices[:, faces.ravel()], np.arange(faces.size).reshape(-1, 3)


def double_sided(moving: Moving) -> Moving:
    """Each triangle from both sides, with vertices of its own for each side."""
    vertices, faces = moving
    other = faces[:, ::-1] + vertices.shape[1]
    return np.concatenate([vertices, vertices], axis=1), np.concatenate([faces, other])


def signed(moving: Moving, **parameters: Any) -> tuple[MeshSequence, ModalSignature]:
    sequence = mesh_sequence(*moving, unit="mm")
    return sequence, modal_signature(sequence, SignatureParameters(**parameters))


def assert_alike(one: ModalSignature, other: ModalSignature) -> None:
    assert one.surface == other.surface
    # RMS and p95 are over the vertices sent, of which there are more.
    for name in ("amplitudes", "weighted_rms_errors", "max_errors", "weighted_motion_rms"):
        found, expected = getattr(one, name), getattr(other, name)
        np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max() + 1e-12)
    np.testing.assert_allclose(one.lengths, other.lengths, rtol=1e-9)
    np.testing.assert_allclose(one.angular_frequencies, other.angular_frequencies, rtol=1e-9)


@pytest.mark.parametrize("topology", ["cup", "sphere", "torus", "cylinder"])
def test_two_rims_at_the_same_places_are_one(topology: str) -> None:
    whole = surface(topology)
    sequence, one = signed(cut_in_two(whole))
    _, other = signed(whole)
    assert one.surface == topology
    assert_alike(one, other)
    n = whole[0].shape[1]
    assert (one.n_vertices, sequence.n_vertices > n) == (sequence.n_vertices, True)
    (note,) = [note for note in one.notes if "coincide" in note]
    assert note.text.startswith(f"{sequence.n_vertices - n} vertices of {sequence.n_vertices}")
    assert not [note for note in one.notes if "no triangle" in note or "no area" in note]
    # Surfaces back: of the vertices sent, in their order.
    positions = reconstruct(one, sequence)
    assert positions.shape == sequence.vertices.shape
    assert (positions == positions[:, sequence.representatives]).all()
    distances = np.linalg.norm(positions - sequence.vertices, axis=2)
    np.testing.assert_allclose(np.sqrt((distances**2).mean(axis=1)), one.rms_errors, atol=1e-9)


@pytest.mark.every(2)
@pytest.mark.parametrize(
    "parameters",
    [
        {"components": Components.CYLINDRICAL},
        {"topology": "mesh"},
        {"reference": "mean"},
        {"modes": 18},
        {"landmarks": GivenLandmarks(theta_zero=3)},
    ],
)
def test_it_is_so_for_every_request(parameters: dict[str, Any]) -> None:
    whole = surface()
    assert_alike(signed(cut_in_two(whole), **parameters)[1], signed(whole, **parameters)[1])


@pytest.mark.parametrize("change", [triangle_soup, double_sided])
def test_seams_and_second_sides_change_nothing(change: Any) -> None:
    whole = surface("sphere", 120)
    sequence, one = signed(change(whole))
    other_sequence, other = signed(whole)
    assert one.surface == "sphere"
    found, expected = one.weighted_rms_errors, other.weighted_rms_errors
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)
    found = clinical_readouts(one, sequence).curve.volumes
    expected = clinical_readouts(other, other_sequence).curve.volumes
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    if change is double_sided:
        (note,) = [note for note in one.notes if "repeat" in note]
        assert note.text.startswith(f"{len(whole[1])} triangles")


def test_single_precision_and_minus_zero_are_the_same_places() -> None:
    vertices, faces = cut_in_two(surface())
    vertices = vertices.astype(np.float32)
    vertices[..., 0] -= vertices[0, 0, 0]
    sequence = mesh_sequence(vertices, faces)
    at_zero = vertices == 0
    at_zero[:, : surface()[0].shape[1]] = False
    other = mesh_sequence(np.where(at_zero, np.float32(-0.0), vertices), faces)
    assert make_template(sequence).surface == make_template(other).surface
    assert is_merged(other.representatives)


def test_rims_that_part_in_one_frame_are_two() -> None:
    vertices, faces = cut_in_two(surface())
    vertices = vertices.copy()
    vertices[5, -1] += 1e-12
    template = make_template(mesh_sequence(vertices, faces))
    assert template.representatives[-1] == vertices.shape[1] - 1
    vertices = vertices.copy()
    vertices[5, surface()[0].shape[1] :] += 1e-9
    assert make_template(mesh_sequence(vertices, faces)).surface is None


@pytest.mark.parametrize("topology", ["sphere", "cup"])
def test_a_surface_that_touches_itself_in_a_point_stays_a_surface(topology: str) -> None:
    """Always in a point: joined there it would be no surface."""
    vertices, faces = surface(topology)
    pressed = vertices.copy()
    pressed[:, 5] = pressed[:, 90]
    template = make_template(mesh_sequence(pressed, faces))
    assert template.topology.name == topology
    assert not is_merged(template.representatives)


def test_openings_that_touch_stay_two() -> None:
    vertices, faces = surface("cylinder")
    low, high = (opening[0, 0] for opening in connectivity_of(faces, vertices.shape[1]).loops)
    vertices = vertices.copy()
    vertices[:, low] = vertices[:, high]
    assert not is_merged(mesh_sequence(vertices, faces).representatives)


def test_a_doubled_vertex_in_no_triangle_moves_with_its_twin() -> None:
    vertices, faces = surface()
    doubled = mesh_sequence(np.concatenate([vertices[:, 7:8], vertices], axis=1), faces + 1)
    template = make_template(doubled)
    assert template.representatives[[0, 8]].tolist() == [0, 0]
    assert not len(template.isolated)
    assert template.weights[8] == 0.0
    assert_alike(modal_signature(doubled), modal_signature(mesh_sequence(vertices, faces)))


def test_vertices_around_which_triangles_name_either_copy_are_one() -> None:
    vertices, faces = surface()
    rng = np.random.default_rng(8)
    n = vertices.shape[1]
    doubled = rng.permutation(n)[:80]
    copies = np.arange(n)
    copies[doubled] = n + np.arange(80)
    mixed = np.where(rng.random(faces.shape) < 0.5, copies[faces], faces)
    sequence = mesh_sequence(np.concatenate([vertices, vertices[:, doubled]], axis=1), mixed)
    assert_alike(modal_signature(sequence), modal_signature(mesh_sequence(vertices, faces)))


def test_the_rows_of_poles_and_the_seam_of_a_globe_are_merged() -> None:
    """As graphics programs write a sphere: a grid of 12 x 9 quads, its poles rows of vertices."""
    theta, phi = np.meshgrid(np.linspace(0, 2 * np.pi, 13), np.linspace(0, np.pi, 9))
    theta[:, -1], ring = 0.0, np.sin(phi)
    ring[[0, -1]] = 0.0
    x = np.stack([ring * np.cos(theta), ring * np.sin(theta), 1.5 * np.cos(phi)], axis=-1)
    a = (np.arange(8)[:, None] * 13 + np.arange(12)).ravel()
    faces = np.concatenate([np.stack([a, a + 13, a + 1], 1), np.stack([a + 1, a + 13, a + 14], 1)])
    sequence = mesh_sequence(np.stack([x.reshape(-1, 3), 1.1 * x.reshape(-1, 3)]), faces)
    template = make_template(sequence)
    assert template.topology.name == "sphere"
    assert len(np.unique(template.representatives)) == 2 + 7 * 12


def test_the_template_is_stored_with_its_merged_vertices() -> None:
    template = make_template(mesh_sequence(*cut_in_two(surface())))
    kept = template_from_hdf5(template_to_hdf5(template))
    np.testing.assert_array_equal(kept.representatives, template.representatives)
    assert is_merged(kept.representatives)
    plain = make_template(mesh_sequence(*surface()))
    kept = template_from_hdf5(template_to_hdf5(plain))
    np.testing.assert_array_equal(kept.representatives, np.arange(plain.n_vertices))


def test_normals_stand_on_all_vertices_sent() -> None:
    template = make_template(mesh_sequence(*cut_in_two(surface("sphere"))))
    normals = vertex_normals(template)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    np.testing.assert_array_equal(normals, normals[template.representatives])


def test_a_sequence_that_parts_what_its_template_merges_is_noted() -> None:
    vertices, faces = cut_in_two(surface())
    template = make_template(mesh_sequence(vertices, faces))
    parted = vertices.copy()
    parted[3, -2:] += 0.5
    parameters = SignatureParameters(template=template.id)
    noted = modal_signature(mesh_sequence(parted, faces), parameters, template=template)
    assert any(note.text.startswith("2 vertices that the template merges") for note in noted.notes)
    same = modal_signature(mesh_sequence(vertices, faces), parameters, template=template)
    assert not any("merges with another" in note for note in same.notes)


def test_a_surface_in_one_place_is_refused() -> None:
    vertices, faces = surface()
    sequence = mesh_sequence(np.ones_like(vertices), faces)
    with pytest.raises(TopologyError, match="no surface"):
        modal_signature(sequence)


@pytest.mark.parametrize("topology", ["open curve", "closed curve"])
def test_points_of_a_curve_keep_their_order(topology: str) -> None:
    turn = np.linspace(0.0, 1.5, 20)
    path = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    path[7] = path[6]
    sequence = mesh_sequence(np.stack([path, 1.1 * path]), topology=topology)
    assert not is_merged(sequence.representatives)


@pytest.mark.parametrize("topology", ["cup", "cylinder", "plane", "sphere", "torus"])
@pytest.mark.parametrize("reference", [0, "mean"])
def test_making_a_template_tells_how_far_it_is(topology: str, reference: Any) -> None:
    seen: list[Progress] = []
    make_template(mesh_sequence(*surface(topology)), reference=reference, report=seen.append)
    told = [progress.share for progress in seen]
    assert len(told) > 2
    assert told == sorted(told)
    assert 0 < told[0] < told[-1] <= 1


def test_the_solution_is_part_of_what_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Multigrid, which tells each of its steps, from a few hundred unknowns on."""
    monkeypatch.setattr(laplacian, "LARGE", 1000)
    seen: list[Progress] = []
    make_template(mesh_sequence(*surface(n=2500)), report=seen.append)
    told = [progress.share for progress in seen]
    assert told == sorted(told)
    assert max(np.diff(told[:-1])) < 0.2
    assert len(told) > 10
