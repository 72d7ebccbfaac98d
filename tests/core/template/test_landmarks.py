"""Axis, ends and zero of theta: inferred by integrals, or given."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial import Delaunay
from template_surfaces import MAKERS, cup_points, make_ventricle, sheet_points

from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import mesh_sequence, standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import PLANE
from modalmotion.template import GivenLandmarks, Landmarks, make_template


def landmarks_of(topology: str, n_frames: Any = None, **given: Any) -> Landmarks:
    vertices, faces = MAKERS[topology](900, np.random.default_rng(0))
    sequence = mesh_sequence(vertices[:n_frames], faces, topology=topology)
    found = make_template(sequence, landmarks=GivenLandmarks(**given)).landmarks
    assert found is not None
    return found


def angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1)))


@pytest.mark.parametrize("topology", sorted(MAKERS))
def test_they_make_a_right_handed_frame(topology: str) -> None:
    found = landmarks_of(topology)
    frame = np.stack([found.theta_zero, np.cross(found.axis, found.theta_zero), found.axis])
    assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1.0)
    assert all(0 <= strength <= 1 for strength in found.strengths.values())
    assert found.given == ()


@pytest.mark.every(4)
@pytest.mark.parametrize("topology", sorted(MAKERS))
@pytest.mark.parametrize("n", [450, 1800])
def test_another_triangulation_turns_them_little(topology: str, n: int) -> None:
    one = landmarks_of(topology)
    sequence = mesh_sequence(*MAKERS[topology](n, np.random.default_rng(7)), topology=topology)
    other = make_template(sequence).landmarks
    assert other is not None
    assert angle(one.axis, other.axis) < np.radians(0.5)
    if "theta_zero" not in one.weak:
        assert angle(one.theta_zero, other.theta_zero) < np.radians(2.0)
    for name, strength in one.strengths.items():
        assert other.strengths[name] == pytest.approx(strength, abs=0.06), name


def test_a_surface_of_revolution_has_no_zero_of_theta() -> None:
    points, faces = cup_points(900, np.random.default_rng(0), 0.0)
    template = make_template(mesh_sequence((points * [20, 20, 50])[None], faces))
    assert template.landmarks is not None
    assert template.landmarks.weak == ("theta_zero",)
    assert any("zero of theta" in note for note in template.notes)
    leaning = points * [20, 20, 50]
    leaning[:, 0] += 0.3 * leaning[:, 2]
    template = make_template(mesh_sequence(leaning[None], faces))
    assert template.landmarks is not None
    assert template.landmarks.weak == ()
    assert abs(template.landmarks.theta_zero @ [0, 1, 0]) < 0.05


def test_what_holds_without_a_zero_of_theta_is_said_where_that_is_named() -> None:
    flat = standard_surface(Lattice(PLANE, (12, 14)))
    template = make_template(mesh_sequence(flat.vertices, flat.faces, topology="cup"))
    assert template.landmarks is not None
    assert {"axis", "base", "theta_zero"} <= {*template.landmarks.weak}
    (told,) = (note for note in template.notes if "cosine and the sine" in note)
    assert told.text.startswith("The zero of theta")


def test_theta_is_right_handed_about_the_axis_and_zero_where_given() -> None:
    vertices, faces = make_ventricle(900, np.random.default_rng(0))
    place = (10.0, 40.0, -5.0)
    # Of one frame, whose noise no other tells.
    template = make_template(
        mesh_sequence(vertices[:1], faces), landmarks=GivenLandmarks(theta_zero=place)
    )
    found = template.landmarks
    assert found is not None
    offsets = vertices[0] - found.origin
    theta = 2 * np.pi * template.coordinates[:, 1]
    along = found.theta_zero * np.cos(theta)[:, None]
    along += np.cross(found.axis, found.theta_zero) * np.sin(theta)[:, None]
    across = offsets - np.outer(offsets @ found.axis, found.axis)
    assert np.linalg.norm(np.cross(along, across), axis=1).max() < 1e-9
    assert (np.einsum("ij,ij->i", along, across) >= 0).all()
    towards = np.array(place) - found.origin
    towards -= towards @ found.axis * found.axis
    assert angle(found.theta_zero, towards) < 1e-7
    assert found.strengths["theta_zero"] == 1.0


def test_apex_and_base_give_the_axis() -> None:
    vertices, _ = make_ventricle(900, np.random.default_rng(0))
    apex = int(np.argmin(vertices[0, :, 2]))
    found = landmarks_of("cup", 1, apex=apex, base=(3.0, 1.0, 30.0))
    assert angle(found.axis, np.array([3.0, 1.0, 30.0]) - vertices[0, apex]) < 1e-7
    assert found.apex == pytest.approx(vertices[0, apex])
    assert found.base == pytest.approx([3, 1, 30])
    # The origin is the foot of the centroid, so that theta turns about the given line.
    line = found.origin - vertices[0, apex]
    assert np.linalg.norm(np.cross(line, found.axis)) < 1e-9
    only_base = landmarks_of("cup", 1, base=(3.0, 1.0, 30.0))
    assert angle(only_base.axis, np.array([3.0, 1.0, 30.0]) - only_base.origin) < 1e-7
    assert set(found.given) == {"apex", "base"}
    assert found.strengths["axis"] == found.strengths["apex"] == 1.0


@pytest.mark.parametrize("topology", ["sphere", "cylinder"])
def test_the_ends_can_be_told_apart(topology: str) -> None:
    sequence = mesh_sequence(*MAKERS[topology](900, np.random.default_rng(0)), topology=topology)
    before = make_template(sequence)
    assert before.landmarks is not None
    apex, base = before.landmarks.apex, before.landmarks.base
    swapped = make_template(
        sequence, landmarks=GivenLandmarks(apex=tuple(base.tolist()), base=tuple(apex.tolist()))
    )
    assert swapped.landmarks is not None
    assert angle(swapped.landmarks.axis, before.landmarks.axis) > np.radians(170)
    assert np.corrcoef(swapped.coordinates[:, 0], before.coordinates[:, 0])[0, 1] < -0.99
    only = make_template(sequence, landmarks=GivenLandmarks(base=tuple(apex.tolist())))
    assert np.corrcoef(only.coordinates[:, 0], swapped.coordinates[:, 0])[0, 1] > 0.99


def test_the_sense_of_a_torus_axis() -> None:
    found = landmarks_of("torus")
    turned = landmarks_of("torus", base=tuple((found.origin - 10 * found.axis).tolist()))
    assert turned.axis == pytest.approx(-found.axis)


def test_corners_of_a_plane() -> None:
    places, faces = sheet_points(900, np.random.default_rng(0))
    faces = Delaunay(places).simplices
    vertices = np.concatenate([places * [30, 20], np.zeros((len(places), 1))], axis=1)[None]
    corners = [
        int(np.argmin(np.linalg.norm(places - corner, axis=1)))
        for corner in ([1, 0], [1, 1], [0, 1], [0, 0])
    ]
    sequence = mesh_sequence(vertices, faces, topology="plane")
    for order, expected in (
        (corners, np.stack([places[:, 1], 1 - places[:, 0]], axis=1)),
        (corners[::-1], np.stack([places[:, 1], places[:, 0]], axis=1)),
    ):
        template = make_template(sequence, landmarks=GivenLandmarks(corners=tuple(order)))  # type: ignore[arg-type]
        # On a rectangle the harmonic coordinates are the rectangle's own.
        assert template.coordinates == pytest.approx(expected, abs=1e-9)
        assert template.landmarks is not None
        assert template.landmarks.strengths["theta_zero"] == 1.0
    one, two, three, four = corners
    for wrong in ((one, three, two, four), (one, two, two, four)):
        with pytest.raises(ParameterError, match="along the rim"):
            make_template(sequence, landmarks=GivenLandmarks(corners=wrong))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"apex": 900_000}, "vertex 900000, but there are"),
        ({"apex": -1}, "neither a vertex nor a point"),
        ({"theta_zero": (1.0, 2.0)}, "neither a vertex nor a point"),
        ({"theta_zero": (1.0, np.nan, 0.0)}, "neither a vertex nor a point"),
        ({"base": "top"}, "neither a vertex nor a point"),
        ({"base": True}, "neither a vertex nor a point"),
        ({"corners": (1, 2, 3, 4)}, "means nothing on a cup"),
        ({"corners": (1, 2, 3)}, "3 places, not four"),
        ({"apex": 5, "base": 5}, "coincide"),
    ],
)
def test_places_that_are_none(given: dict[str, object], message: str) -> None:
    with pytest.raises(ParameterError, match=message) as caught:
        landmarks_of("cup", **given)
    assert caught.value.remedy


def test_the_zero_of_theta_off_the_axis() -> None:
    found = landmarks_of("cup")
    with pytest.raises(ParameterError, match="is on the axis"):
        landmarks_of("cup", theta_zero=tuple((found.origin + 7 * found.axis).tolist()))


def test_springs_and_lattices_take_none() -> None:
    vertices, faces = make_ventricle(300, np.random.default_rng(0))
    given = GivenLandmarks(theta_zero=3)
    with pytest.raises(ParameterError, match="without natural coordinates"):
        make_template(mesh_sequence(vertices, faces), landmarks=given, closed_form=False)
    lattice = mesh_sequence(
        np.random.default_rng(0).normal(size=(1, 24, 3)), grid=(4, 6), topology="cup"
    )
    with pytest.raises(ParameterError, match="lattice"):
        make_template(lattice, landmarks=given)


def test_landmarks_are_part_of_the_identity() -> None:
    sequence = mesh_sequence(*make_ventricle(300, np.random.default_rng(0)))
    ids = {
        make_template(sequence, landmarks=given).id
        for given in (None, GivenLandmarks(theta_zero=3), GivenLandmarks(theta_zero=4))
    }
    assert len(ids) == 3
