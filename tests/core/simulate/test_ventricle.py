"""Simulated sequences: volumes, meshes, recordings, and how far they are from a real heart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.mesh import Cavity
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topologies import CUP
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.simulate import (
    Acquisition,
    Pose,
    Spacing,
    VentricleParameters,
    simulate_ventricle,
)

HEALTHY = VentricleParameters()


def naive_volume(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> float:
    """Sum of signed tetrahedra, triangle by triangle, each opening closed by a fan."""
    directed = {(int(f[i]), int(f[(i + 1) % 3])) for f in faces for i in range(3)}
    border = {a: b for a, b in directed if (b, a) not in directed}
    triangles = [tuple(vertices[i] for i in face) for face in faces]
    while border:
        loop = [next(iter(border))]
        while (following := border.pop(loop[-1])) != loop[0]:
            loop.append(following)
        centre = vertices[loop].mean(axis=0)
        pairs = zip(loop, loop[1:] + loop[:1], strict=True)
        triangles += [(centre, vertices[b], vertices[a]) for a, b in pairs]
    return float(sum(np.linalg.det(np.stack(corners)) for corners in triangles)) / 6


def volumes(sequence: MeshSequence) -> NDArray[np.float64]:
    return Cavity(sequence.faces).volume(sequence.vertices.astype(np.float64))


def test_a_cavity_is_closed_where_it_is_open(rng: np.random.Generator) -> None:
    box = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    quads = [(0, 2, 3, 1), (0, 1, 5, 4), (1, 3, 7, 5), (3, 2, 6, 7), (2, 0, 4, 6)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    assert Cavity(faces).volume(box + 1e4) == pytest.approx(1.0, abs=1e-9)
    assert len(Cavity(faces).openings[0]) == 4
    sequence = simulate_ventricle(grid=(6, 10), acquisition=Acquisition(n_frames=2))
    assert volumes(sequence)[1] == pytest.approx(
        naive_volume(sequence.vertices[1].astype(float), sequence.faces), rel=1e-12
    )


@pytest.mark.every(3)
@pytest.mark.parametrize("n_vertices", [None, 700])
@pytest.mark.parametrize(
    "change",
    [
        {},
        {"ejection_fraction": 0.25, "longitudinal_shortening": 0.06},
        {"ejection_fraction": 0.42, "akinesia": 1.0},
        {"ejection_fraction": 0.35, "delay": 0.12, "septal_flash": 0.3},
        {"shape_variation": 2.0, "motion_variation": 2.0},
    ],
)
def test_the_ejection_fraction_is_reached(
    change: dict[str, float], n_vertices: int | None, rng: np.random.Generator
) -> None:
    p = replace(HEALTHY, **change)
    sequence = simulate_ventricle(
        p, grid=(16, 32), n_vertices=n_vertices, acquisition=Acquisition(n_frames=600), rng=rng
    )
    v = volumes(sequence)
    assert v.argmax() in (0, 1, 2, 598, 599) or v.max() < 1.01 * v[0]
    # Frames 1.4 ms apart may miss the smallest volume by that much squared.
    assert 1 - v.min() / v[0] == pytest.approx(p.ejection_fraction, abs=2e-6)


def test_nothing_moves_without_ejection_shortening_and_twist() -> None:
    p = replace(
        HEALTHY,
        ejection_fraction=0.0,
        longitudinal_shortening=0.0,
        apex_rotation=0.0,
        base_rotation=0.0,
    )
    vertices = simulate_ventricle(p, grid=(8, 16)).vertices
    assert np.abs(vertices - vertices[0]).max() <= 1e-12


def test_the_volume_falls_rests_fills_and_is_topped_up() -> None:
    sequence = simulate_ventricle(grid=(12, 24), acquisition=Acquisition(n_frames=200))
    v, beat = volumes(sequence), HEALTHY.beat
    assert sequence.times is not None
    at = {
        name: int(np.argmin(np.abs(sequence.times - t)))
        for name, t in (
            ("systole", beat.end_systole),
            ("relaxed", beat.relaxed),
            ("filled", beat.filled),
        )
    }
    assert (np.diff(v[13 : at["systole"]]) < 0).all()
    assert np.ptp(v[at["systole"] : at["relaxed"]]) <= 1e-3 * v[0]
    assert (np.diff(v[at["relaxed"] + 2 : at["filled"]]) > 0).all()
    share = (v[at["filled"]] - v.min()) / (v[0] - v.min())
    assert 0.6 < share < 0.85  # the rest is the atrial kick
    assert v[-1] == pytest.approx(v[0], rel=1e-3)


def test_a_lattice_is_laid_out_as_promised() -> None:
    sequence = simulate_ventricle(grid=(10, 16), acquisition=Acquisition(n_frames=5))
    assert (sequence.unit, sequence.grid, sequence.topology) == ("mm", (10, 16), CUP)
    assert sequence.times == pytest.approx(np.arange(5) / 5 * HEALTHY.period)
    nodes = sequence.vertices[0].reshape(10, 16, 3)
    heights = nodes[:, :, 2].mean(axis=1)
    assert (np.diff(heights) > 0).all()
    assert heights[0] < 0.02 * HEALTHY.length
    angles = np.unwrap(np.arctan2(nodes[5, :, 1], nodes[5, :, 0]))
    assert np.diff(angles) == pytest.approx(np.full(15, 2 * np.pi / 16))
    assert volumes(sequence)[0] > 0  # wound outward
    by_height = simulate_ventricle(grid=(10, 16), spacing=Spacing.HEIGHT)
    rows = by_height.vertices[0].reshape(10, 16, 3)[:, 0, 2]
    assert np.allclose(np.diff(rows), np.diff(rows).mean())


def test_a_triangulation_is_honest(rng: np.random.Generator) -> None:
    sequence = simulate_ventricle(n_vertices=900, acquisition=Acquisition(n_frames=2), rng=rng)
    x, faces = sequence.vertices[0].astype(float), sequence.faces
    assert (sequence.n_vertices, sequence.grid) == (900, None)
    assert np.array_equal(np.unique(faces), np.arange(900))
    assert np.abs(x[0]).max() <= 1e-9  # the apex is a vertex
    cavity = Cavity(faces)
    loop = cavity.openings[0][:, 0]
    assert len(cavity.openings) == 1
    assert x[loop, 2] == pytest.approx(np.full(len(loop), HEALTHY.length))
    edges = {tuple(sorted((int(f[i]), int(f[(i + 1) % 3])))) for f in faces for i in range(3)}
    assert 900 - len(edges) + len(faces) == 1  # a disc
    assert cavity.volume(x) > 0
    degrees = np.bincount(np.array(list(edges)).ravel())
    assert set(degrees) >= {4, 5, 6, 7}
    sides = np.stack(
        [np.linalg.norm(x[faces[:, i]] - x[faces[:, i - 1]], axis=1) for i in range(3)]
    )
    areas = np.linalg.norm(
        np.cross(x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]]), axis=1
    )
    # Twice the area over the longest side squared: the triangle's height over its width.
    assert np.quantile(areas / sides.max(axis=0) ** 2, 0.01) > 0.2
    assert areas.max() < 8 * np.median(areas)


def test_one_individual_on_two_meshes_moves_alike() -> None:
    p = replace(HEALTHY, shape_variation=2.0, motion_variation=2.0, delay=0.05)
    few, many = (
        simulate_ventricle(p, grid=(16, n), rng=np.random.default_rng(3)) for n in (32, 64)
    )
    columns = many.vertices.reshape(25, 16, 64, 3)[:, :, 1::2]
    assert np.abs(few.vertices.reshape(25, 16, 32, 3) - columns).max() < 0.02


def test_recordings_start_close_drift_and_carry_noise(rng: np.random.Generator) -> None:
    plain = simulate_ventricle(grid=(8, 16), acquisition=Acquisition(n_frames=20))
    closed = simulate_ventricle(grid=(8, 16), acquisition=Acquisition(n_frames=21, is_closed=True))
    assert np.allclose(closed.vertices[:-1], plain.vertices)
    assert np.allclose(closed.vertices[-1], plain.vertices[0])
    later = simulate_ventricle(grid=(8, 16), acquisition=Acquisition(n_frames=20, start_phase=0.25))
    assert np.allclose(later.vertices, np.roll(plain.vertices, -5, axis=0))
    noisy = simulate_ventricle(
        grid=(8, 16), acquisition=Acquisition(n_frames=20, noise=0.6), rng=rng
    )
    assert (noisy.vertices - plain.vertices).std() == pytest.approx(0.6, rel=0.03)
    turned = simulate_ventricle(
        grid=(8, 16),
        acquisition=Acquisition(n_frames=20, pose=Pose(rotation=(0.4, -2.0, 1.0))),
    )
    assert volumes(turned) == pytest.approx(volumes(plain), rel=1e-12)


def test_the_same_generator_gives_the_same_sequence() -> None:
    p = replace(HEALTHY, motion_variation=1.0)
    a, b, other = (
        simulate_ventricle(p, n_vertices=200, rng=np.random.default_rng(seed)).id
        for seed in (5, 5, 6)
    )
    assert a == b != other


def test_what_cannot_be_simulated_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(ParameterError, match="generator"):
        simulate_ventricle(n_vertices=200)
    with pytest.raises(ParameterError, match="generator"):
        simulate_ventricle(replace(HEALTHY, motion_variation=1.0))
    with pytest.raises(ParameterError, match="cannot be reached"):
        simulate_ventricle(replace(HEALTHY, ejection_fraction=0.02, longitudinal_shortening=0.35))
    with pytest.raises(ParameterError, match="12 vertices"):
        simulate_ventricle(n_vertices=12, rng=rng)
    for grid in ((8, 15), (0, 16)):
        with pytest.raises(ShapeError):
            simulate_ventricle(grid=grid)
    with pytest.raises(ParameterError):
        Acquisition(n_frames=0)
    with pytest.raises(ParameterError):
        Acquisition(noise=-1.0)


def errors_of(sequence: MeshSequence) -> NDArray[np.float64]:
    """RMS motion and what 7, 18 and 37 modes leave of it, mm."""
    found = [modal_signature(sequence, SignatureParameters(modes=n)) for n in (7, 18, 37)]
    motion = float(np.sqrt((found[0].motion_rms ** 2).mean()))
    return np.array([motion, *(signature.rms_error for signature in found)])


def test_modes_leave_as_much_as_on_a_real_ventricle(
    real_sequence: Callable[[str], MeshSequence],
) -> None:
    real = errors_of(real_sequence("heart/lv_grid_32x64").with_topology(CUP, None))
    p = replace(HEALTHY, shape_variation=2.0, motion_variation=2.2)
    simulated = errors_of(simulate_ventricle(p, rng=np.random.default_rng(0)))
    assert (simulated > 0.5 * real).all()
    assert (simulated < 1.5 * real).all()
