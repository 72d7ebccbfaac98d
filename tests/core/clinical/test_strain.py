"""Strain of a ventricle's wall: laws, outside numbers, noise, intervals."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import ellipe, ellipeinc

import modalmotion as mm
from modalmotion.clinical.segments import RINGS, SEGMENTS
from modalmotion.clinical.smooth_wall import smooth_walls
from modalmotion.clinical.strain import NAMES, Strain, measures_of, wall_strain
from modalmotion.clinical.wall_motion import WallMotion
from modalmotion.errors import ParameterError, TopologyError
from modalmotion.mesh import Facts
from modalmotion.mesh.checks import Uncertainty
from modalmotion.mesh.geometry import vertex_normals
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence, standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CUP, TORUS
from modalmotion.notes import Note
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion.template import make_template


def stretched(*factors: tuple[float, float, float], facts: Facts | None = None) -> MeshSequence:
    still = standard_surface(Lattice(CUP, (24, 48))).vertices[0]
    frames = np.stack([still * np.array(factor) for factor in ((1.0, 1.0, 1.0), *factors)])
    return mesh_sequence(frames, grid=(24, 48), topology=CUP, facts=facts or Facts())


def strain_of(sequence: MeshSequence, end: int = 1) -> Strain:
    return wall_strain(sequence, make_template(sequence), 0, end)


@cache
def beat(n_vertices: int | None = None) -> MeshSequence:
    return simulate_ventricle(
        grid=(32, 64),
        n_vertices=n_vertices,
        acquisition=Acquisition(n_frames=12),
        rng=np.random.default_rng(3),
    )


def noisy(sequence: MeshSequence, noise: float, seed: int) -> MeshSequence:
    rng = np.random.default_rng([7, seed])
    x = sequence.vertices.astype(np.float64)
    return replace(sequence, vertices=x + noise * rng.normal(size=x.shape))


def line_lengths(lattice: MeshSequence) -> tuple[float, float]:
    """GLS and GCS of frame 5 by lines of the lattice, from base to base and around."""
    assert lattice.grid is not None
    rows, columns = lattice.grid
    x = lattice.vertices[[0, 5]].astype(np.float64).reshape(2, rows, columns, 3)
    half = columns // 2
    lines = np.concatenate([x[:, ::-1, :half], x[:, :, half:]], axis=1)
    along = np.linalg.norm(np.diff(lines, axis=1), axis=3).sum(axis=1)
    around = np.linalg.norm(x - np.roll(x, 1, axis=2), axis=3).sum(axis=2)
    strains = (100.0 * (lengths[1] / lengths[0] - 1.0) for lengths in (along, around))
    gls, gcs = (float(strain.mean()) for strain in strains)
    return gls, gcs


def test_an_even_scaling_is_the_same_strain_everywhere_whatever_the_pose() -> None:
    still = stretched((0.8, 0.8, 0.8), (1.1, 1.1, 1.1))
    turn = Rotation.from_euler("xyz", [20, 40, 60], degrees=True).as_matrix()
    moved = [still.vertices[0], *(x @ turn + 50.0 for x in still.vertices[1:])]
    for sequence in (still, replace(still, vertices=np.stack(moved))):
        strain = strain_of(sequence)
        of_lengths = [0, 1, 3, 4, 5]
        np.testing.assert_allclose(strain.curves[1, of_lengths], -20.0, atol=1e-9)
        np.testing.assert_allclose(strain.curves[2, of_lengths], 10.0, atol=1e-9)
        np.testing.assert_allclose(strain.curves[1:, 2], [-36.0, 21.0], atol=1e-9)
        np.testing.assert_allclose(strain.by_segment[1, :, :2], -20.0, atol=1e-9)
        assert strain.segments == RINGS
        assert strain.peak["GLS"].value == pytest.approx(-20.0, abs=1e-9)


def test_an_ellipsoid_of_unequal_shares_as_by_elliptic_integrals() -> None:
    # Half an ellipsoid, apex down: meridians and parallels are ellipses.
    rows, columns = 48, 64
    s = (np.arange(rows) + 0.5) / rows
    theta = 2 * np.pi * np.arange(columns) / columns
    polar, azimuth = np.meshgrid(np.pi / 2 * s, theta, indexing="ij")
    unit = np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), -np.cos(polar)], axis=2
    ).reshape(-1, 3)
    rest, short = np.array([25.0, 25.0, 70.0]), np.array([18.0, 18.0, 58.0])
    frames = np.stack([unit * rest, unit * short])
    strain = strain_of(mesh_sequence(frames, grid=(rows, columns), topology=CUP))

    def quarter(axes: NDArray[np.float64]) -> float:
        # From the apex to the last row, polar angle p: E of the complement, with a^2 sin^2.
        p, (a, _, c) = np.pi / 2 * s[-1], axes
        m = 1.0 - (a / c) ** 2
        return float(c * (ellipe(m) - ellipeinc(np.pi / 2 - p, m)))

    assert strain.end_systolic["GLS"].value == pytest.approx(
        100.0 * (quarter(short) / quarter(rest) - 1.0), abs=0.1
    )
    assert strain.end_systolic["GCS"].value == pytest.approx(100.0 * (18 / 25 - 1.0), abs=0.1)


@pytest.mark.parametrize("n_vertices", [None, 1500])
def test_noise_of_a_millimetre_does_not_move_it(n_vertices: int | None) -> None:
    gls, gcs = line_lengths(beat())
    found = [strain_of(noisy(beat(n_vertices), 1.0, k), 5).end_systolic for k in range(3)]
    assert np.mean([abs(one["GLS"].value - gls) for one in found]) < 0.6
    assert np.mean([abs(one["GCS"].value - gcs) for one in found]) < 0.9
    assert all(one["GLS"].high - one["GLS"].low < 3.0 for one in found)


def test_intervals_hold_what_is_found_without_noise() -> None:
    clean = strain_of(beat(), 5).end_systolic
    found = [strain_of(noisy(beat(), 1.0, k), 5).end_systolic for k in range(4)]
    for name in ("GLS", "GCS", "GAS"):
        errors = np.array([one[name].value - clean[name].value for one in found])
        # An interval is four standard deviations wide.
        stated = np.array([(one[name].high - one[name].low) / 4.0 for one in found])
        assert 0.2 < np.sqrt(np.mean((errors / stated) ** 2)) < 1.6


def test_rows_of_a_track_keep_their_heights_however_its_vertices_slide() -> None:
    """The data of a track show nothing of sliding; those of a mesh follow its vertices."""
    polar = np.repeat((np.arange(24) + 0.5) / 24 * np.pi / 2, 48)
    around = np.tile(2 * np.pi * np.arange(48) / 48, 24)

    def bowl(polar: NDArray[np.float64], *axes: float) -> NDArray[np.float64]:
        across = np.sin(polar)
        unit = (across * np.cos(around), across * np.sin(around), -np.cos(polar))
        return np.asarray(np.stack(unit, axis=1) * np.array(axes))

    slid = polar + 0.1 * np.sin(2.0 * polar)
    frames = np.stack([bowl(polar, 25, 25, 80), bowl(slid, 20, 20, 70)])
    mesh = mesh_sequence(frames, grid=(24, 48), topology=CUP)
    known = Uncertainty.of_noise(0.1, 2, mesh.n_vertices, mesh.n_vertices)
    track = replace(mesh, uncertainty=known)
    for level in ("apical", "mid", "basal"):
        # Lines of tissue, which a track does not see, are longer by 0.02 of this.
        assert strain_of(track).at(f"GCS {level}", 1).value == pytest.approx(-19.6, abs=0.5)
    assert strain_of(mesh).at("GCS apical", 1).value > -10.0


def test_noise_is_taken_off_lengths_and_areas_by_what_it_adds() -> None:
    clean = simulate_ventricle(grid=(16, 32), acquisition=Acquisition(n_frames=12))
    end = strain_of(clean, 5).curves[5, :3]
    found = np.array([strain_of(noisy(clean, 1.0, k), 5).curves[5, :3] for k in range(12)])
    error = found.std(axis=0, ddof=1) / np.sqrt(len(found))
    assert (np.abs(found.mean(axis=0) - end) < 3.0 * error).all()


def test_another_frame_that_noise_may_have_made_end_systole_is_within_the_interval() -> None:
    # Two of the same volume: noise makes either the smaller, most often by little.
    shapes = stretched((0.8, 0.8, 1.0), (0.85, 0.85, 0.64 / 0.85**2))
    exact = strain_of(shapes)
    held = 0
    for seed in range(12):
        hazy = mm.strain(noisy(shapes, 0.005, seed))
        _, low, high = hazy.end_systolic["GLS"]
        held += low < exact.curves[3 - hazy.end_systole, 0] < high
    assert held >= 5


def test_known_errors_of_positions_count_and_their_notes_are_passed_on() -> None:
    sequence = beat()
    n = sequence.n_vertices

    def tracked(sd: float) -> Strain:
        covariance = np.tile(sd**2 * np.eye(3), (sequence.n_frames, 1, 1))
        known = Uncertainty(
            source="points",
            shapes=sequence.vertices[0, :, 2:].astype(np.float64) / 40.0,
            across=covariance,
            along=covariance,
            rest=np.zeros(sequence.n_frames),
            alike=np.ones(n),
            notes=(Note("told", "A caveat of the track."),),
        )
        return strain_of(replace(sequence, uncertainty=known), 5)

    one, two = tracked(1.0), tracked(2.0)
    assert one.source == "points"
    assert "A caveat of the track." in map(str, one.notes)
    # The mode lengthens the surface along its axis by a fortieth.
    place = one.names.index("GLS")
    assert two.deviations[5, place] > 1.8 * one.deviations[5, place] > 1.0


def test_segments_need_the_anterior_wall_and_strain_no_material_points() -> None:
    sequence = beat()
    facts = replace(
        sequence.facts, tracking="normal_displacement", landmarks={"anterior": (0.0, -20.0, 40.0)}
    )
    strain = strain_of(sequence.with_facts(facts), 5)
    assert strain.segments == SEGMENTS
    assert np.isfinite(strain.by_segment).all()
    assert (strain.segment_deviations > 0).all()
    assert strain.end_systolic["GLS"].value == pytest.approx(line_lengths(sequence)[0], abs=0.5)


def test_what_has_no_wall_is_refused() -> None:
    with pytest.raises(TopologyError, match="topology=cup"):
        strain_of(replace(standard_surface(Lattice(TORUS, (16, 24)))), 0)
    small = mesh_sequence(
        np.stack([standard_surface(Lattice(CUP, (4, 6))).vertices[0]] * 2),
        grid=(4, 6),
        topology=CUP,
    )
    with pytest.raises(ParameterError, match="finer mesh"):
        strain_of(small)


def test_rows_of_a_track_move_with_its_ends_to_first_order() -> None:
    """Errors of one frame against its own finite difference, at the apex and along all."""
    whole = simulate_ventricle(grid=(24, 48), acquisition=Acquisition(n_frames=12))
    x = whole.vertices[[0, 5]].astype(np.float64)
    template = make_template(whole)
    wall, _ = smooth_walls(template, is_lattice=True)
    known = Uncertainty.of_noise(0.1, 2, whole.n_vertices, whole.n_vertices)
    motion = WallMotion.of(x, known, wall, 0)
    apical = measures_of(motion)[NAMES.index("GCS apical")]
    s, axis = template.coordinates[:, 0], np.array([0.0, 0.0, 1.0])
    for share in (np.exp(-((s / 0.25) ** 2)), np.cos(np.pi * s)):
        for directions in (vertex_normals(x[1], template.faces), np.tile(axis, (len(s), 1))):
            moved = 0.02 * share[:, None] * directions
            found = [
                WallMotion.of(np.stack([x[0], x[1] + way * moved]), known, wall, 0)
                for way in (1.0, -1.0)
            ]
            change = np.subtract(*(each.strain(apical, 0)[1] for each in found)) / 2.0
            gradient, _ = motion.gradients(apical, 1, 0)
            assert change == pytest.approx(np.sum(gradient * (wall.projector @ moved)), rel=0.1)
