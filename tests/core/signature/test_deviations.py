"""Deviations in signatures: from tracks, from noise, on request and not otherwise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from clouds import breathing_spheroid, sampled
from template_surfaces import MAKERS

from modalmotion.clinical import clinical_readouts
from modalmotion.clinical.strain import strain
from modalmotion.mesh import Facts, lattice_faces
from modalmotion.mesh.checks import Uncertainty
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topologies import CYLINDER
from modalmotion.signature.distance import compare
from modalmotion.signature.hdf5 import signature_from_hdf5, signature_to_hdf5
from modalmotion.signature.making import SignatureKind, SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import at_times
from modalmotion.signature.value import first_modes
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion.template import GivenLandmarks, choose_modes, make_template
from modalmotion.tracking import Track, track

ALONG_NORMALS = SignatureParameters(kind=SignatureKind.NORMAL_DISPLACEMENT, modes=4)
BALL = breathing_spheroid(6)


@pytest.fixture(scope="module")
def tracked() -> Track:
    rng = np.random.default_rng(0)
    clouds = [sampled(x, BALL.faces, 200, rng, 0.5) for x in BALL.vertices]
    return track(clouds, modes=9, unit="mm")


@pytest.fixture(scope="module")
def noisy() -> MeshSequence:
    beat = breathing_spheroid(20)
    noise = np.random.default_rng(1).normal(0.0, 0.3, beat.vertices.shape)
    return mesh_sequence(beat.vertices + noise, beat.faces, unit="mm")


@pytest.mark.every(2)
@pytest.mark.parametrize("kind", SignatureKind)
def test_tracked_sequences_have_deviations(tracked: Track, kind: SignatureKind) -> None:
    signature = modal_signature(tracked.sequence, replace(ALONG_NORMALS, kind=kind))
    stated = signature.amplitude_deviations
    assert stated is not None
    assert stated.shape == signature.amplitudes.shape
    assert (stated[1:] > 0).all()
    assert any("track" in note for note in signature.notes)


def test_normal_displacements_of_a_track_are_as_far_off_as_stated(tracked: Track) -> None:
    true = modal_signature(BALL, ALONG_NORMALS).amplitudes
    signature = modal_signature(tracked.sequence, ALONG_NORMALS)
    assert signature.amplitude_deviations is not None
    # The first mode is the mean normal displacement: it does not depend on where the axis points.
    off = (signature.amplitudes - true)[1:, 0]
    ratio = np.sqrt((off**2).mean() / (signature.amplitude_deviations[1:, 0] ** 2).mean())
    assert 0.3 < ratio < 2.0


def test_material_motion_of_a_track_is_less_sure_than_its_normal_displacements(
    tracked: Track,
) -> None:
    normal = modal_signature(tracked.sequence, ALONG_NORMALS)
    material = modal_signature(
        tracked.sequence, replace(ALONG_NORMALS, kind=SignatureKind.MATERIAL)
    )
    assert normal.deviation_share is not None
    assert material.deviation_share is not None
    assert material.deviation_share > 1.2 * normal.deviation_share


def test_deviations_follow_from_the_noise_on_request(noisy: MeshSequence) -> None:
    assert modal_signature(noisy).amplitude_deviations is None
    clean = breathing_spheroid(20)
    # A body of revolution: where theta begins on the noisy one is another error.
    template = make_template(clean)
    parameters = SignatureParameters(modes=4, deviations=True, template=template.id)
    true = modal_signature(clean, parameters, template=template)
    signature = modal_signature(noisy, parameters, template=template)
    stated = signature.amplitude_deviations
    assert stated is not None
    off = (signature.amplitudes - true.amplitudes)[1:]
    assert np.sqrt((off**2).mean() / (stated[1:] ** 2).mean()) == pytest.approx(1.0, abs=0.35)
    assert any("noise" in note for note in signature.notes)


def test_normal_displacements_have_them_on_request_too(noisy: MeshSequence) -> None:
    stated = modal_signature(noisy, replace(ALONG_NORMALS, deviations=True)).amplitude_deviations
    assert stated is not None
    assert 0.0 < stated[1:].mean() < 0.1


def test_auto_states_them_with_its_noise(noisy: MeshSequence) -> None:
    signature = modal_signature(noisy, SignatureParameters(auto=True))
    assert signature.amplitude_deviations is not None
    assert signature.amplitude_deviations.shape == signature.amplitudes.shape


def test_vertices_that_count_for_less_are_as_independent_as_others(noisy: MeshSequence) -> None:
    asked, n = SignatureParameters(modes=7), noisy.n_vertices
    assert 1.0 / (make_template(noisy).weights ** 2).sum() < 0.85 * n
    estimated = modal_signature(noisy, replace(asked, deviations=True)).amplitude_deviations
    known = replace(noisy, uncertainty=Uncertainty.of_noise(0.3, noisy.n_frames, n, n))
    stated = modal_signature(known, asked).amplitude_deviations
    assert estimated is not None
    assert stated is not None
    assert np.sqrt((estimated**2).mean()) == pytest.approx(np.sqrt((stated**2).mean()), rel=0.05)


def test_deviations_stay_with_their_amplitudes(tracked: Track) -> None:
    signature = modal_signature(tracked.sequence, ALONG_NORMALS)
    stated = signature.amplitude_deviations
    assert stated is not None
    few = first_modes(signature, 2)
    assert few.amplitude_deviations == pytest.approx(stated[:, : len(few.modes)])
    between = at_times(signature, np.array([1.1, 3.0]))
    assert between.amplitude_deviations == pytest.approx(stated[[1, 3]])
    assert between.weighted_rms_errors.shape == (2,)
    again = signature_from_hdf5(signature_to_hdf5(signature))
    assert again.amplitude_deviations is not None
    assert again.amplitude_deviations.tobytes() == stated.tobytes()


def test_a_distance_comes_with_the_one_that_errors_make(tracked: Track) -> None:
    own = modal_signature(tracked.sequence, ALONG_NORMALS)
    true = replace(own, amplitude_deviations=None)
    found = compare(own, modal_signature(tracked.sequence, ALONG_NORMALS))
    assert found.distance == 0.0
    assert found.by_errors is not None
    one = compare(own, true).by_errors
    # Of two with the same errors, their squares add up.
    assert one is not None
    assert found.by_errors == pytest.approx(np.sqrt(2.0) * one, rel=0.1)
    assert compare(true, true).by_errors is None
    tenth = replace(own, amplitude_deviations=0.1 * np.abs(own.amplitudes))
    assert compare(true, tenth).by_errors == pytest.approx(0.1)
    assert compare(tenth, true).by_errors == pytest.approx(0.1)
    in_metres = replace(
        own,
        unit="m",
        amplitudes=own.amplitudes / 1e3,
        amplitude_deviations=np.asarray(own.amplitude_deviations) / 1e3,
    )
    assert compare(in_metres, own).by_errors == pytest.approx(found.by_errors)


def test_a_share_of_nothing_is_none(tracked: Track) -> None:
    signature = modal_signature(tracked.sequence, ALONG_NORMALS)
    still = replace(signature, amplitudes=np.zeros_like(signature.amplitudes))
    assert still.deviation_share == np.inf
    zero = np.zeros_like(signature.amplitudes)
    assert replace(signature, amplitude_deviations=zero).deviation_share == 0.0


@pytest.mark.parametrize("given", [{}, {"theta_zero": 40}], ids=["by shape", "landmark"])
@pytest.mark.parametrize("topology", ["cup", "cylinder"])
def test_deviations_of_a_recording_of_its_own_template_hold(
    topology: str, given: dict[str, int]
) -> None:
    vertices, faces = MAKERS[topology](400, np.random.default_rng(0))
    clean = mesh_sequence(vertices, faces, topology=topology, unit="mm")
    own = SignatureParameters(landmarks=GivenLandmarks.from_json(given))
    template = make_template(clean, landmarks=own.landmarks)
    fixed = SignatureParameters(template=template.id)
    rng, f, n = np.random.default_rng(2), clean.n_frames, clean.n_vertices
    found, at_fixed, stated = [], [], []
    for _ in range(24):
        noise = rng.normal(0.0, 0.5, vertices.shape)
        noisy = replace(
            clean,
            vertices=vertices + noise,
            uncertainty=Uncertainty.of_noise(0.5, f, n, n),
        )
        signature = modal_signature(noisy, own)
        found.append(signature.amplitudes[1:])
        at_fixed.append(modal_signature(noisy, fixed, template=template).amplitudes[1:])
        assert signature.amplitude_deviations is not None
        stated.append(signature.amplitude_deviations[1:] ** 2)
    true = np.sqrt(np.var(found, axis=0, ddof=1).mean())
    # Errors of axes are the same in all frames: 24 draws tell their size to a seventh.
    assert 0.8 < np.sqrt(np.mean(stated)) / true < 1.25
    assert true < 1.5 * np.sqrt(np.var(at_fixed, axis=0, ddof=1).mean())


def test_a_zero_of_theta_that_nobody_knows_widens_no_read_out() -> None:
    # A body of revolution: of a pair, cosine and sine are known together alone.
    beat = simulate_ventricle(
        n_vertices=500,
        acquisition=Acquisition(n_frames=10, noise=0.6),
        rng=np.random.default_rng(4),
    ).with_facts(Facts(tracking="material"))
    plain, sure = (
        modal_signature(beat, SignatureParameters(deviations=asked)) for asked in (False, True)
    )
    deviations = sure.amplitude_deviations
    assert deviations is not None
    assert any("zero of theta" in note for note in sure.notes)
    # The first two modes of a cup are even around its axis, the next four are pairs.
    of_pairs = np.sqrt((deviations[1:, 2:6] ** 2).mean())
    assert of_pairs > 0.3 * np.sqrt((sure.amplitudes[1:, 2:6] ** 2).mean())
    assert of_pairs > 5.0 * np.sqrt((deviations[1:, :2] ** 2).mean())
    curves = [clinical_readouts(one, beat).curve for one in (plain, sure)]
    assert np.array_equal(curves[0].volumes, curves[1].volumes)
    assert np.array_equal(curves[0].bounds, curves[1].bounds)
    strains = [strain(one, beat) for one in (plain, sure)]
    assert np.array_equal(strains[0].curves, strains[1].curves)
    assert np.array_equal(strains[0].deviations, strains[1].deviations)


@pytest.mark.parametrize("asked", [{"modes": 120}, {"auto": True}])
def test_a_turn_about_which_vertices_cannot_tell_the_modes_apart_counts_for_nothing(
    asked: dict[str, Any], rng: np.random.Generator
) -> None:
    s, turn = np.meshgrid((np.arange(12) + 0.5) / 12, np.arange(16) / 8 * np.pi, indexing="ij")
    rest = np.stack([(10 + 3 * s) * np.cos(turn), 9 * np.sin(turn), 120 * s], axis=2).reshape(-1, 3)
    faces = lattice_faces(CYLINDER, (12, 16))
    template = make_template(mesh_sequence(rest[None], faces, unit="mm"))
    shapes = choose_modes(template, 120)[0].shapes_on(template)
    # A motion of so many modes that `auto` keeps them.
    u = shapes @ rng.normal(0.0, 0.2, (shapes.shape[1], 3))
    phases = 2 * np.pi * np.arange(12) / 12
    x = rest + np.sin(phases)[:, None, None] * u + rng.normal(0.0, 1e-4, (12, *rest.shape))
    # All vertices off together: the axis may lie across the tube, where most have one angle.
    known = Uncertainty.of_noise(100.0, 12, len(rest), 1.0)
    tube = replace(mesh_sequence(x, faces, unit="mm"), uncertainty=known)
    signature = modal_signature(tube, SignatureParameters(**asked))
    assert len(signature.modes) >= 120
    stated = signature.amplitude_deviations
    assert stated is not None
    assert (stated[1:] > 0).all()
