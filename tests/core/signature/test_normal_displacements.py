"""Normal displacements: of the surface, not its points; outward, without rotation and drift."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from modalmotion.errors import TopologyError
from modalmotion.mesh import lattice_faces
from modalmotion.mesh.sequence import MEAN, MeshSequence, Reference, mesh_sequence
from modalmotion.modes.topologies import CUP, CYLINDER, Topology
from modalmotion.signature.making import (
    ModalSignature,
    SignatureKind,
    SignatureParameters,
    modal_signature,
)
from modalmotion.signature.normal_displacements import normal_reference
from modalmotion.signature.reconstruction import reconstruct
from modalmotion.simulate import Acquisition, Spacing, VentricleParameters, simulate_ventricle
from modalmotion.template import GivenLandmarks, make_template
from modalmotion.template.template import shapes_of

ALONG_NORMALS = SignatureParameters(kind=SignatureKind.NORMAL_DISPLACEMENT)
GRID = (24, 48)
VARIED = VentricleParameters(shape_variation=2.0, motion_variation=1.0)
BEAT = simulate_ventricle(
    VARIED,
    grid=GRID,
    acquisition=Acquisition(n_frames=8),
    rng=np.random.default_rng(5),
)
MESH_BEAT = simulate_ventricle(
    VARIED,
    n_vertices=600,
    acquisition=Acquisition(n_frames=6),
    rng=np.random.default_rng(5),
)


def slid(sequence: MeshSequence) -> MeshSequence:
    """The same moving surface of a lattice with points elsewhere on it: round it, along it."""
    assert sequence.grid is not None
    rows, columns = sequence.grid
    s, theta = np.arange(rows) / (rows - 1), np.arange(columns + 1) / columns
    frames = []
    for k, x in enumerate(sequence.vertices.astype(float)):
        share = np.sin(np.pi * k / sequence.n_frames) ** 2
        cells = x.reshape(rows, columns, 3)
        around = CubicSpline(
            theta, np.concatenate([cells, cells[:, :1]], axis=1), axis=1, bc_type="periodic"
        )
        turned = np.stack(
            [
                around((theta[:-1] + share * (0.03 + 0.04 * (at - 0.5))) % 1.0)[row]
                for row, at in enumerate(s)
            ]
        )
        along = CubicSpline(s, turned, axis=0)
        frames.append(along(s + 0.06 * share * np.sin(np.pi * s) ** 2).reshape(-1, 3))
    return replace(sequence, vertices=np.stack(frames))


def fitted(sequence: MeshSequence, **options: object) -> ModalSignature:
    return modal_signature(sequence, replace(ALONG_NORMALS, **options))  # type: ignore[arg-type]


def apart(a: ModalSignature, b: ModalSignature) -> float:
    x, y = (one.amplitudes - one.amplitudes.mean(axis=0) for one in (a, b))
    return float(np.linalg.norm(x - y) / np.linalg.norm(y))


def moved(sequence: MeshSequence, turn: NDArray[np.float64]) -> MeshSequence:
    """Each frame turned and shifted further than the one before."""
    k = np.arange(sequence.n_frames)
    R = Rotation.from_rotvec(k[:, None] * turn).as_matrix()
    shifts = k[:, None, None] * np.array([3.0, -2.0, 5.0])
    return replace(sequence, vertices=sequence.vertices @ R.transpose(0, 2, 1) + shifts)


@pytest.mark.parametrize("reference", [0, MEAN])
def test_points_that_slide_over_the_surface_change_nothing(reference: Reference) -> None:
    other = slid(BEAT)
    assert apart(fitted(other, reference=reference), fitted(BEAT, reference=reference)) < 0.03
    material = [
        modal_signature(one, SignatureParameters(reference=reference)) for one in (other, BEAT)
    ]
    assert apart(*material) > 0.2


def test_a_sphere_that_grows_is_one_amplitude_in_its_radius(
    sphere: MeshSequence,
) -> None:
    signature = fitted(sphere)
    growth = np.array([0.0, 1.0, 2.5])
    np.testing.assert_allclose(signature.amplitudes[:, 0, 0], growth, rtol=5e-3, atol=1e-12)
    assert np.abs(signature.amplitudes[:, 1:]).max() < 1e-2
    np.testing.assert_allclose(signature.motion_rms, growth, rtol=5e-3, atol=1e-12)


@pytest.fixture
def sphere() -> MeshSequence:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=3, radius=10.0)
    vertices = np.stack([ball.vertices * r / 10.0 for r in (10.0, 11.0, 12.5)])
    return mesh_sequence(vertices, np.asarray(ball.faces), unit="mm")


@pytest.mark.parametrize("turn", [np.zeros(3), np.array([0.1, -0.2, 0.15])])
def test_rotation_and_drift_are_taken_out_and_returned(turn: NDArray[np.float64]) -> None:
    own, other = fitted(BEAT), fitted(moved(BEAT, turn))
    np.testing.assert_allclose(other.amplitudes, own.amplitudes, atol=2e-2)
    k = np.arange(BEAT.n_frames)
    R = Rotation.from_rotvec(k[:, None] * turn).as_matrix()
    expected = R @ own.rotations.matrices
    np.testing.assert_allclose(other.rotations.matrices, expected, atol=5e-3)


def test_rotation_stays_where_it_is_not_to_be_removed() -> None:
    turn = np.array([0.02, 0.03, 0.0])
    signature = fitted(moved(BEAT, turn), remove_rotation=False)
    np.testing.assert_array_equal(signature.rotations.matrices, np.tile(np.eye(3), (8, 1, 1)))
    assert apart(signature, fitted(BEAT)) > 0.2


def test_what_repeats_the_reference_has_no_normal_displacement_to_the_last_bit() -> None:
    signature = fitted(BEAT)
    for values in (signature.amplitudes, signature.rms_errors, signature.translations):
        assert not values[0].any()


def test_inward_is_negative_whichever_way_triangles_are_wound() -> None:
    signature = fitted(MESH_BEAT)
    narrow = signature.amplitudes[np.abs(signature.amplitudes[:, 0, 0]).argmax(), 0, 0]
    assert narrow < -2.0
    turned = replace(MESH_BEAT, faces=np.ascontiguousarray(MESH_BEAT.faces[:, ::-1]))
    np.testing.assert_allclose(fitted(turned).amplitudes, signature.amplitudes, atol=1e-9)


def test_a_mesh_and_a_lattice_of_one_ventricle_have_nearly_the_same_normal_displacements() -> None:
    mesh = simulate_ventricle(
        VARIED, n_vertices=1000, acquisition=Acquisition(n_frames=8), rng=np.random.default_rng(5)
    )
    a, b = fitted(mesh).body_amplitudes[:, 0], fitted(BEAT).body_amplitudes[:, 0]
    assert np.linalg.norm(a - b) / np.linalg.norm(b) < 0.05


def test_the_order_of_the_vertices_hardly_matters() -> None:
    # Points follow a spiral, and some of them say how the surface turns: these from all sides.
    rng = np.random.default_rng(11)
    mesh = simulate_ventricle(
        VARIED, n_vertices=2000, acquisition=Acquisition(n_frames=4), rng=np.random.default_rng(5)
    )
    order = rng.permutation(mesh.n_vertices)
    place = np.argsort(order)
    other = replace(mesh, vertices=mesh.vertices[:, order], faces=place[mesh.faces])
    a, b = fitted(mesh, modes=16), fitted(other, modes=16)
    assert apart(a, b) < 0.01
    turns = a.rotations.matrices.transpose(0, 2, 1) @ b.rotations.matrices
    assert np.degrees(Rotation.from_matrix(turns).magnitude()).max() < 0.3


@pytest.mark.parametrize("topology", [CUP, CYLINDER])
def test_a_lattice_has_the_normal_displacements_of_the_triangles_between_its_nodes(
    topology: Topology,
) -> None:
    lattice = replace(BEAT, topology=topology)
    triangles = mesh_sequence(
        BEAT.vertices, lattice_faces(topology, GRID), topology=topology, unit="mm", times=BEAT.times
    )
    a = fitted(lattice)
    assert a.landmarks is not None
    # Its columns say where theta is zero, and its rows which end is which.
    zero, base = a.landmarks.origin + 10.0 * a.landmarks.theta_zero, a.landmarks.base
    given = GivenLandmarks(
        theta_zero=tuple(zero.tolist()), base=tuple(base.tolist()) if topology == CYLINDER else None
    )
    b = fitted(triangles, landmarks=given)
    np.testing.assert_allclose(a.amplitudes, b.amplitudes, atol=1e-9)
    # Material points are where their rows and columns are.
    assert make_template(lattice).id != make_template(lattice, by_rows=False).id


def test_where_the_rows_of_a_lattice_lie_hardly_matters() -> None:
    beats = [
        simulate_ventricle(
            VARIED,
            grid=GRID,
            spacing=spacing,
            acquisition=Acquisition(n_frames=5),
            rng=np.random.default_rng(5),
        )
        for spacing in Spacing
    ]
    assert apart(*(fitted(beat) for beat in beats)) < 0.03
    assert apart(*(modal_signature(beat, SignatureParameters()) for beat in beats)) > 0.05


@pytest.mark.parametrize("scale", [1e-150, 1e-3, 1e150])
def test_normal_displacements_grow_with_the_unit(scale: float) -> None:
    scaled = replace(MESH_BEAT, vertices=MESH_BEAT.vertices * scale)
    amplitudes = fitted(scaled).amplitudes / scale
    np.testing.assert_allclose(amplitudes, fitted(MESH_BEAT).amplitudes, atol=1e-6)


def test_vertices_in_no_triangle_and_doubled_ones_change_nothing() -> None:
    x = MESH_BEAT.vertices
    loose = mesh_sequence(
        np.concatenate([x, x[:, :1] + 500.0, x[:, 3:4]], axis=1),
        MESH_BEAT.faces,
        topology=CUP,
        unit="mm",
        times=MESH_BEAT.times,
    )
    a, b = fitted(loose), fitted(MESH_BEAT)
    np.testing.assert_allclose(a.amplitudes, b.amplitudes, atol=1e-9)
    np.testing.assert_allclose(a.max_errors, b.max_errors, atol=1e-9)


def test_reconstruction_moves_the_reference_along_its_normals() -> None:
    signature = fitted(BEAT)
    template = make_template(BEAT, by_rows=False)
    directions, centre = normal_reference(template, template.vertices)
    # Rotation and drift taken out again.
    surface = reconstruct(signature, BEAT) - centre - signature.translations[:, None]
    u = surface @ signature.rotations.matrices - (template.vertices - centre)
    along = np.einsum("fnj,nj->fn", u, directions[:, 0])
    expected = signature.amplitudes[:, :, 0] @ shapes_of(signature.modes, template).T
    np.testing.assert_allclose(along, expected, atol=1e-9)
    np.testing.assert_allclose(u, along[:, :, None] * directions[:, 0], atol=1e-9)


def test_more_modes_bring_the_reconstruction_to_the_surface() -> None:
    errors = [fitted(BEAT, modes=n).rms_error for n in (1, 7, 37, 111)]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.3 < fitted(BEAT).weighted_motion_rms.max()


def test_surfaces_without_a_side_or_a_normal_are_refused_with_a_remedy() -> None:
    n = 40
    t = 2 * np.pi * np.arange(n) / n
    middle = np.stack([np.cos(t), np.sin(t), 0 * t], axis=1) * 10
    half = np.stack([np.cos(t / 2) * np.cos(t), np.cos(t / 2) * np.sin(t), np.sin(t / 2)], axis=1)
    band = np.stack([middle - half, middle + half], axis=1).reshape(-1, 3)
    i = 2 * np.arange(n - 1)
    faces = np.concatenate(
        [
            np.stack([i, i + 1, i + 2], axis=1),
            np.stack([i + 1, i + 3, i + 2], axis=1),
            [[2 * n - 2, 2 * n - 1, 1], [2 * n - 1, 0, 1]],
        ]
    )
    moebius = mesh_sequence(np.stack([band, band * 1.1]), faces)
    with pytest.raises(TopologyError, match="one-sided") as caught:
        fitted(moebius, modes=4)
    assert "kind material" in str(caught.value.remedy)
    curve = mesh_sequence(np.stack([middle, middle * 1.1]), topology="closed curve", grid=None)
    with pytest.raises(TopologyError, match="curve"):
        fitted(curve, modes=3)
