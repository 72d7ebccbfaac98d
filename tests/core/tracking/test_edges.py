"""Edges on profiles: where they are found, and where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.tracking.image_view import DISTINCT, FAINT, Edges, Levels, find_edges, offsets_of

STEP, REACH = 0.5, 8.0
OFFSETS = offsets_of(STEP, REACH)
LEVELS = Levels(100.0, 40.0, 5.0)


def found(edge: np.ndarray | float, *, crossing: float = 1.0, noise: float = 0.0) -> Edges:
    edge = np.atleast_1d(np.asarray(edge, dtype=np.float64))
    inside = np.clip(0.5 - (OFFSETS - edge[:, None]) / 1.5, 0.0, 1.0)
    values = 40.0 + 60.0 * inside
    values += np.random.default_rng(0).normal(0.0, noise, values.shape) if noise else 0.0
    like = LEVELS.likeness(values)
    return find_edges(like, STEP, REACH, np.ones(len(edge)), crossing)


def test_edges_are_found_between_samples() -> None:
    true = np.linspace(-6.9, 6.9, 57)
    own = found(true)
    assert own.is_found.all()
    assert own.offsets == pytest.approx(true, abs=0.05)
    assert own.steps.min() > 0.8


def test_noise_moves_edges_by_less_than_a_sample_and_not_to_one_side() -> None:
    true = np.tile(np.linspace(-5, 5, 21), 40)
    off = found(true, noise=20.0).offsets - true
    assert np.abs(off).mean() < STEP
    assert abs(np.median(off)) < 0.1


def test_noise_alone_has_hardly_an_edge() -> None:
    values = np.random.default_rng(1).normal(70.0, 20.0, (500, len(OFFSETS)))
    own = find_edges(LEVELS.likeness(values), STEP, REACH, np.ones(500), 1.0)
    assert own.is_found.mean() < 0.15


def test_a_muscle_before_the_edge_is_crossed_only_where_that_is_cheap() -> None:
    values = np.where(OFFSETS < 4.0, 100.0, 40.0)
    values[(OFFSETS > -4.0) & (OFFSETS < 0.0)] = 40.0
    like = LEVELS.likeness(values[None])
    assert find_edges(like, STEP, REACH, np.ones(1), 0.35).offsets == pytest.approx([4.0], abs=0.3)
    assert find_edges(like, STEP, REACH, np.ones(1), 2.0).offsets == pytest.approx([-4.0], abs=0.3)


def test_an_edge_beside_a_layer_lies_between_the_layer_and_the_outside() -> None:
    true = np.linspace(-5.0, 5.0, 41)[:, None]
    values = 40.0 + 60.0 * np.clip(0.5 - (OFFSETS - true) / 1.5, 0.0, 1.0)
    values -= 30.0 * np.clip(0.5 - (OFFSETS - true) / 1.5, 0.0, 1.0) * (true - 5.0 < OFFSETS)
    like = LEVELS.likeness(values)
    plain, layered = (
        find_edges(like, STEP, REACH, np.ones(41), 0.35, layer) for layer in (-np.inf, 0.45)
    )
    assert plain.offsets.mean() < true.mean() - 0.8
    assert layered.offsets == pytest.approx(true[:, 0], abs=0.15)
    assert layered.inside == pytest.approx(0.0, abs=0.1)
    assert (plain.inside == 1.0).all()


def test_neither_noise_nor_labels_have_layers() -> None:
    assert (LEVELS.layer(DISTINCT), LEVELS.layer(FAINT)) == pytest.approx((0.45, 0.7))
    noisy, labels = Levels(100.0, 40.0, 30.0), Levels(100.0, 0.0, 1e-10)
    assert noisy.layer(DISTINCT) == noisy.layer(FAINT) < 0.0
    assert labels.layer(DISTINCT) == labels.layer(FAINT) == -np.inf


def test_either_sign_of_contrast_and_any_gain_are_alike() -> None:
    values = 40.0 + 60.0 * np.clip(0.5 - OFFSETS[None] / 1.5, 0.0, 1.0)
    plain = LEVELS.likeness(values)
    assert Levels(-100.0, -40.0, 5.0).likeness(-values) == pytest.approx(plain)
    assert LEVELS.likeness(1.3 * values, 1.3) == pytest.approx(plain)
    assert LEVELS.likeness(np.array([np.nan])) == pytest.approx([0.0])
