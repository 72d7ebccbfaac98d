"""What a mesh is taken for, what is refused, and what falls back on its own springs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bent_surfaces import bent_beat
from template_surfaces import MAKERS, Moving, describe, shared, sheet

from modalmotion.errors import ParameterError, TopologyError
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topologies import CUP, SPHERE, Topology
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.template import make_template, require_same_mesh, template_id


def surface(topology: str, n: int = 300) -> Moving:
    return MAKERS[topology](n, np.random.default_rng(0))


def sequence_of(topology: str, n: int = 300, *, stated: str | None = None) -> MeshSequence:
    return mesh_sequence(*surface(topology, n), topology=stated)


@pytest.mark.parametrize("topology", ["cup", "sphere", "torus", "cylinder"])
def test_it_is_found_from_the_connectivity(topology: str) -> None:
    template = make_template(sequence_of(topology))
    assert template.topology.name == topology
    assert template.surface is not None
    assert np.isfinite(template.coordinates).all()
    assert template.weights.sum() == pytest.approx(1.0, abs=1e-12)
    for axis, ends in enumerate(template.topology.ends):
        if axis not in template.topology.closed_axes:
            s = template.coordinates[:, axis]
            assert s.min() == pytest.approx(0.0, abs=0.05), ends
            assert s.max() == pytest.approx(1.0, abs=0.05)


def test_a_sheet_is_a_cup_unless_it_is_flat_or_stated() -> None:
    assert make_template(sequence_of("plane")).topology.name == "cup"
    assert make_template(sequence_of("plane", stated="plane")).topology.name == "plane"
    vertices, faces = surface("plane")
    flat = make_template(mesh_sequence(vertices * [1, 1, 0], faces))
    assert flat.topology.name == "plane"
    assert any("set topology=cup" in note for note in flat.notes)
    # A flat disk stated as a cup has its normal for an axis.
    disk = make_template(mesh_sequence(vertices * [1, 1, 0], faces, topology="cup"))
    assert disk.landmarks is not None
    assert np.abs(disk.landmarks.axis) == pytest.approx([0, 0, 1], abs=1e-9)


def with_hole(moving: Moving, place: int, rings: int = 2) -> Moving:
    """Cut out the triangles around a vertex."""
    vertices, faces = moving
    inside = np.zeros(vertices.shape[1], dtype=np.bool_)
    inside[place] = True
    for _ in range(rings - 1):
        inside[faces[inside[faces].any(axis=1)]] = True
    used, faces = np.unique(faces[~inside[faces].any(axis=1)], return_inverse=True)
    return vertices[:, used], faces.reshape(-1, 3)


def test_several_openings_may_belong_to_one_base() -> None:
    vertices, faces = surface("cup", 1200)
    height = vertices[0, :, 2]
    twice = with_hole((vertices, faces), int(np.argmin(np.abs(height))))
    template = make_template(mesh_sequence(*twice))
    assert template.topology.name == "cup"
    assert template.landmarks is not None
    assert template.landmarks.n_loops == 2
    apex = int(np.argmin(height))
    assert make_template(mesh_sequence(*with_hole((vertices, faces), apex))).topology.name == (
        "cylinder"
    )


def test_openings_all_around_are_no_cup() -> None:
    vertices, faces = surface("sphere", 1500)
    moving = (vertices, faces)
    for direction in ([1, 0, 0], [-1, 0.9, 0], [-1, -0.9, 0]):
        places = moving[0][0] - moving[0][0].mean(axis=0)
        moving = with_hole(moving, int(np.argmax(places @ direction)))
    template = make_template(mesh_sequence(*moving))
    assert template.surface is None
    assert "openings are not at one end" in template.reason


def test_stated_against_the_connectivity() -> None:
    with pytest.raises(TopologyError, match=r"has 1 piece.*1 boundary loop") as caught:
        make_template(sequence_of("cup", stated="sphere"))
    assert "State cup or plane" in str(caught.value)
    with pytest.raises(TopologyError, match="State torus"):
        make_template(sequence_of("torus", stated="sphere"))
    with pytest.raises(TopologyError, match="State sphere"):
        make_template(sequence_of("sphere", stated="cup"))
    # Two openings may be told to belong to one base.
    assert make_template(sequence_of("cylinder", stated="cup")).topology == CUP


def test_points_alone_say_nothing() -> None:
    vertices, _ = surface("cup")
    with pytest.raises(TopologyError, match="without faces, grid or topology"):
        make_template(mesh_sequence(vertices))
    with pytest.raises(TopologyError, match=r"no edges join .* \(grid\)"):
        make_template(mesh_sequence(vertices, topology="cup"))
    with pytest.raises(TopologyError, match="no edges join"):
        make_template(mesh_sequence(vertices), closed_form=False)
    with pytest.raises(TopologyError, match="has no topology"):
        make_template(mesh_sequence(vertices[:, :24], grid=(4, 6)))


def doubled(moving: Moving) -> Moving:
    vertices, faces = moving
    n = vertices.shape[1]
    return np.concatenate([vertices, vertices + 100], axis=1), np.concatenate([faces, faces + n])


def book(moving: Moving) -> Moving:
    vertices, faces = moving
    page = np.concatenate([faces[:1, :2], [[vertices.shape[1]]]], axis=1)
    return np.concatenate([vertices, vertices[:, :1] + 5], axis=1), np.concatenate([faces, page])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (doubled, "2 pieces"),
        (book, "more than two triangles, the first between vertices"),
    ],
)
def test_anything_else_gets_its_own_springs(change: object, reason: str) -> None:
    moving = change(surface("cup"))  # type: ignore[operator]
    found = describe(moving, 7)
    assert found.template.surface is None
    assert found.template.surface is None
    assert found.template.coordinates.shape[1] == 0
    assert reason in found.template.reason
    assert any("edges of this mesh" in note for note in found.template.notes)
    assert found.fit.errors.weighted_rms.max() < found.fit.motion.rms.max()
    with pytest.raises(TopologyError, match="spring modes of its own mesh"):
        _ = found.template.topology
    with pytest.raises(TopologyError, match="but the mesh has"):
        make_template(mesh_sequence(*moving, topology="cup"))


def test_a_one_sided_band_is_no_cylinder() -> None:
    n = 40
    turn = 2 * np.pi * np.arange(n) / n
    across = np.stack(
        [np.cos(turn / 2) * np.cos(turn), np.cos(turn / 2) * np.sin(turn), np.sin(turn / 2)], 1
    )
    core = 3 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    vertices = np.concatenate([core - across, core + across])[None]
    low, high = np.arange(n), np.arange(n) + n
    ahead_low, ahead_high = np.append(low[1:], high[0]), np.append(high[1:], low[0])
    faces = np.concatenate(
        [np.stack([low, ahead_low, high], 1), np.stack([ahead_low, ahead_high, high], 1)]
    )
    template = make_template(mesh_sequence(vertices, faces))
    assert "one-sided" in template.reason


def test_a_folded_closed_surface_gets_springs_unless_stated() -> None:
    vertices, faces = surface("sphere", 1200)
    x, y, z = (vertices / np.abs(vertices).max()).transpose(2, 0, 1)
    bent = np.stack([x + 3 * z**2, y, z * 1.2], axis=2) * 30
    template = make_template(mesh_sequence(bent, faces))
    assert template.surface is None
    assert "not around a straight axis" in template.reason
    stated = make_template(mesh_sequence(bent, faces, topology="sphere"))
    assert stated.topology.name == "sphere"
    assert any("fold" in note for note in stated.notes)


def test_a_knotted_torus_gets_springs() -> None:
    t = 2 * np.pi * np.arange(160) / 160
    core = np.stack(
        [(2 + np.cos(3 * t)) * np.cos(2 * t), (2 + np.cos(3 * t)) * np.sin(2 * t), np.sin(3 * t)], 1
    )
    along = np.roll(core, -1, axis=0) - np.roll(core, 1, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(along, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    beside = np.cross(along, across)
    a = 2 * np.pi * np.arange(12) / 12
    wall = np.cos(a)[:, None, None] * across + np.sin(a)[:, None, None] * beside
    vertices = (core + 0.25 * wall).reshape(1, -1, 3)
    i, j = np.meshgrid(np.arange(12), np.arange(160), indexing="ij")
    at = [((i + p) % 12 * 160 + (j + q) % 160).ravel() for p in (0, 1) for q in (0, 1)]
    faces = np.concatenate([np.stack([at[0], at[1], at[2]], 1), np.stack([at[1], at[3], at[2]], 1)])
    template = make_template(mesh_sequence(vertices, faces))
    assert template.surface is None
    assert "not around a straight axis" in template.reason


def test_closed_form_can_be_declined() -> None:
    sequence = sequence_of("cup")
    template = make_template(sequence, closed_form=False)
    assert template.surface is None
    assert template.id != make_template(sequence).id


def test_the_identity_is_that_of_what_it_was_made_from() -> None:
    vertices, faces = surface("cup")
    sequence = mesh_sequence(vertices, faces)
    template = make_template(sequence)
    assert template.id == make_template(sequence).id == template_id(sequence)
    # All frames have a part in it: the axes are those of their mean.
    others = [
        make_template(mesh_sequence(vertices[:-1], faces)),
        make_template(sequence, reference=3),
        make_template(mesh_sequence(vertices, faces, topology="cup")),
        make_template(mesh_sequence(vertices, faces[::-1])),
    ]
    assert len({template.id, *(other.id for other in others)}) == 5


def test_a_template_serves_meshes_that_correspond() -> None:
    vertices, faces = surface("cup")
    template = make_template(mesh_sequence(vertices, faces))
    require_same_mesh(template, mesh_sequence(vertices * 1.1, faces))
    require_same_mesh(template, mesh_sequence(vertices * 1.1))
    with pytest.raises(ParameterError, match="triangles of the template differ"):
        require_same_mesh(template, mesh_sequence(vertices, faces[1:]))
    with pytest.raises(ParameterError, match="vertices, the sequence"):
        require_same_mesh(template, mesh_sequence(vertices[:, :-1]))


def test_no_such_frame() -> None:
    with pytest.raises(ParameterError, match="counted from 0"):
        make_template(sequence_of("cup"), reference=12)


def test_lattices_keep_their_own_coordinates() -> None:
    s, t = np.meshgrid((np.arange(6) + 0.5) / 6, np.arange(1, 9) / 8, indexing="ij")
    wall = np.stack(
        [(1 + s) * np.cos(2 * np.pi * t), (1 + s) * np.sin(2 * np.pi * t), 3 * s], axis=-1
    ).reshape(1, -1, 3)
    template = make_template(mesh_sequence(wall, grid=(6, 8), topology="cylinder"))
    assert template.coordinates[:, 0] == pytest.approx(s.ravel())
    assert template.coordinates[:, 1] == pytest.approx(t.ravel())
    assert template.landmarks is not None
    assert template.landmarks.axis == pytest.approx([0, 0, 1], abs=1e-9)
    # The last column has theta = 1, the same as 0.
    assert template.landmarks.theta_zero == pytest.approx([1, 0, 0], abs=1e-9)
    flat = np.stack(np.meshgrid(np.arange(4.0), np.arange(5.0), [0.0], indexing="ij"), -1)
    plane = make_template(mesh_sequence(flat.reshape(1, -1, 3), grid=(4, 5), topology="plane"))
    assert plane.landmarks is None


def test_the_two_sides_of_a_plane_by_its_moments() -> None:
    places = np.stack(np.meshgrid(np.linspace(0, 1, 41), np.linspace(0, 1, 21), indexing="ij"), -1)
    from scipy.spatial import Delaunay

    flat = places.reshape(-1, 2)
    faces = Delaunay(flat).simplices
    vertices = np.concatenate([flat * [60, 25], np.zeros((len(flat), 1))], axis=1)[None]
    template = make_template(mesh_sequence(vertices, faces, topology="plane"))
    s, t = template.coordinates.T
    # Of a rectangle the second moments are those of the rectangle.
    assert np.minimum(np.abs(s - flat[:, 0]), np.abs(1 - s - flat[:, 0])).max() < 2e-3
    assert np.minimum(np.abs(t - flat[:, 1]), np.abs(1 - t - flat[:, 1])).max() < 2e-3
    assert template.lengths == pytest.approx((60, 25), rel=3e-3)
    assert sheet(flat[:1]).shape == (12, 1, 3)


def test_the_real_meshes() -> None:
    expected: dict[str, Topology | None] = {
        "heart/lv_endocardium": CUP,
        "heart/epicardium": CUP,
        "literature/chickenCrossing": None,
        "robot/Walking": None,
        "fox/walk": None,
    }
    for name, topology in expected.items():
        vertices, faces = shared(name)
        template = make_template(mesh_sequence(vertices[:1], faces))
        assert template.surface == topology, name


def bent(number: int) -> MeshSequence:
    """A closed surface of one mesh, its axis more or less bent: on both sides of the border."""
    rng = np.random.default_rng(number)
    return bent_beat("strong", rng.uniform(0.2, 3.6), rng)


def test_noise_changes_the_kind_of_modes_near_its_border_alone() -> None:
    rng = np.random.default_rng(0)
    kinds, noted = set(), 0
    for number in range(20):
        sequence = bent(number)
        noisy = replace(
            sequence, vertices=sequence.vertices + rng.normal(0.0, 0.5, sequence.vertices.shape)
        )
        one, other = make_template(sequence), make_template(noisy)
        kinds.add(one.surface)
        near = [any("near its border" in note for note in t.notes) for t in (one, other)]
        noted += near[0]
        assert one.surface == other.surface or all(near)
        # A template fixes the kind, as a stated topology does.
        asked = SignatureParameters(template=one.id)
        kind = "mesh" if one.surface is None else "sphere"
        assert modal_signature(noisy, asked, template=one).surface == kind
        assert modal_signature(noisy, SignatureParameters(topology=kind)).surface == kind
    assert kinds == {None, SPHERE}
    assert 5 <= noted < 20


def test_a_stated_kind_has_no_border() -> None:
    near = next(
        one
        for one in map(bent, range(20))
        if any("near its border" in note for note in make_template(one).notes)
    )
    for topology in ("sphere", "mesh"):
        signature = modal_signature(near, SignatureParameters(topology=topology))
        assert not any("near its border" in note for note in signature.notes)
