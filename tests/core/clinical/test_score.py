"""Scores of estimated motions: laws, another mesh, what is stated, the command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import modalmotion as mm
from modalmotion.cli import main
from modalmotion.clinical.score import score

BEAT = mm.simulate_ventricle(
    grid=(12, 24), acquisition=mm.Acquisition(n_frames=6), rng=np.random.default_rng(3)
)


def moved(amount: float) -> mm.MeshSequence:
    """The beat with so much of its motion."""
    x = BEAT.vertices.astype(np.float64)
    return replace(BEAT, vertices=x[:1] + amount * (x - x[:1]))


def test_the_truth_itself_has_no_error() -> None:
    own = score(BEAT, BEAT)
    assert (own.end_point, own.end_point_end_systole, own.along_normal) == pytest.approx((0, 0, 0))
    assert (own.ejection_fraction, own.gls, own.gcs) == pytest.approx((0, 0, 0))
    assert own.inside is None


def test_half_a_motion_is_half_of_it_off() -> None:
    half, none = score(BEAT, moved(0.5)), score(BEAT, moved(0.0))
    assert half.end_point_end_systole == pytest.approx(none.end_point_end_systole / 2)
    assert none.ejection_fraction < half.ejection_fraction < 0 < half.gls < none.gls
    assert 0 < none.along_normal < none.end_point


def test_a_shift_at_the_start_counts_by_what_it_misplaces_alone() -> None:
    shifted = replace(BEAT, vertices=BEAT.vertices + np.float32(1e-3))
    assert score(BEAT, shifted).end_point < 5e-4


def test_landmarks_follow_another_mesh() -> None:
    x = BEAT.vertices.astype(np.float64)
    middles = x[:, BEAT.faces].mean(axis=2)
    a, b, c = BEAT.faces.T
    new = BEAT.n_vertices + np.arange(len(a))
    faces = np.concatenate([np.stack(t, axis=1) for t in ((a, b, new), (b, c, new), (c, a, new))])
    finer = mm.mesh_sequence(np.concatenate([x, middles], axis=1), faces, unit="mm")
    found = score(BEAT, finer)
    assert found.end_point < 0.05
    assert found.along_normal < 1e-6


def test_the_share_within_what_is_stated() -> None:
    noise = np.random.default_rng(4).normal(scale=0.3, size=BEAT.vertices.shape)
    noisy = replace(BEAT, vertices=BEAT.vertices + noise)
    stated = np.full(BEAT.vertices.shape[:2], 0.3)
    wide, narrow = (score(BEAT, noisy, k * stated).inside or 0.0 for k in (1.0, 0.2))
    assert narrow < 0.5 < 0.93 < wide
    with pytest.raises(mm.ShapeError, match="one number for each vertex"):
        score(BEAT, noisy, stated[:, :-1])


def test_other_numbers_of_frames_are_refused() -> None:
    with pytest.raises(mm.ShapeError, match="6 frames, the answer 5"):
        score(BEAT, replace(BEAT, vertices=BEAT.vertices[:5], times=None))


def test_the_command_reads_deviations_and_says_what_does_not_compare(tmp_path: Path) -> None:
    truth, answer = tmp_path / "truth.npz", tmp_path / "answer.npz"
    deviations = np.ones(BEAT.vertices.shape[:2])
    beat: dict[str, Any] = {
        "faces": BEAT.faces,
        "grid": np.array(BEAT.grid),
        "topology": np.array("cup"),
    }
    np.savez(truth, vertices=BEAT.vertices, **beat)
    np.savez(answer, vertices=moved(0.9).vertices, deviations=deviations, **beat)
    text = CliRunner().invoke(main, ["score", str(truth), str(answer)])
    assert text.exit_code == 0, text.output
    assert "2.9, 2.14, 1.96, 1.49 mm" in text.output
    result = CliRunner().invoke(main, ["score", str(truth), str(answer), "--json"])
    assert 0 < json.loads(result.output)["inside"] <= 1
