"""Pieces of known motions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modalmotion.classification import TrainingCase, TrainingOptions, classify, train
from modalmotion.classification.features.patterns import (
    LENGTH,
    MEASURES,
    N_PATTERNS,
    Patterns,
    learn_patterns,
    no_patterns,
    pattern_names,
)
from modalmotion.classification.model.hdf5 import model_from_hdf5, model_to_hdf5
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence


def _terms(n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n, 8, 2, 3)) / 10.0


def test_a_motion_comes_nearest_to_the_pieces_that_were_taken_from_it() -> None:
    terms = _terms(6)
    y = np.array([0, 0, 0, 1, 1, 1])
    patterns = learn_patterns(terms, y, seed=3)
    assert len(patterns) == N_PATTERNS
    assert patterns.pieces.shape == (N_PATTERNS, 6, LENGTH)
    nearest, _, _ = np.split(patterns.features(terms), len(MEASURES), axis=1)
    # Each piece is of one of the motions, which alone is not apart from it.
    np.testing.assert_allclose(nearest.min(axis=0), 0.0, atol=1e-6)
    assert (np.sort(nearest, axis=0)[1] > 1e-3).all()
    # The pieces that compare shapes have neither a mean nor a size.
    shapes = patterns.pieces[patterns.is_shape]
    np.testing.assert_allclose(shapes.mean(axis=2), 0.0, atol=1e-12)
    np.testing.assert_allclose(shapes.std(axis=2), 1.0)


def test_a_place_is_where_the_piece_was() -> None:
    """One piece, looked for in the motion that it was taken from, by hand."""
    terms = _terms(1)
    share = np.linspace(0.0, 1.0, 32)
    cosines = np.cos(np.pi * np.arange(1, 9)[:, None] * share)
    path = np.swapaxes(terms.reshape(1, 8, 6), 1, 2) @ cosines
    piece = path[:, :, 5 : 5 + 2 * LENGTH : 2]
    patterns = Patterns(piece, np.array([2]), np.array([False]), np.array([1e-3]))
    nearest, how_often, where = patterns.features(terms)[0]
    # Squares as differences of products lose half of the digits.
    assert nearest == pytest.approx(0.0, abs=1e-6)
    assert how_often == pytest.approx(0.0, abs=1e-3)
    assert where == pytest.approx(5.0, abs=1e-3)
    # To a wide limit all of its twelve places are alike.
    _, how_often, where = replace(patterns, limits=np.array([1e6])).features(terms)[0]
    assert (how_often, where) == pytest.approx((np.log(12), 5.5))


def test_features_do_not_jump_and_are_numbers_at_rest() -> None:
    terms = _terms(4)
    patterns = learn_patterns(terms, np.array([0, 0, 1, 1]), seed=0)
    # None of these motions is one that a piece was taken from, where distances have a cusp.
    others = _terms(4, seed=1)
    moved = patterns.features(others * (1.0 + 1e-9))
    np.testing.assert_allclose(moved, patterns.features(others), atol=1e-6)
    assert np.isfinite(patterns.features(np.zeros((2, 8, 2, 3)))).all()
    still = learn_patterns(np.zeros((3, 8, 2, 3)), np.array([0, 0, 1]), seed=0)
    assert np.isfinite(still.features(others)).all()


def test_many_motions_have_the_features_of_each() -> None:
    terms = _terms(300)
    patterns = learn_patterns(terms, np.arange(300) % 3, seed=0)
    together = patterns.features(terms)
    for k in (0, 255, 256, 299):
        np.testing.assert_allclose(patterns.features(terms[k : k + 1])[0], together[k], atol=1e-6)


def _one_by_one(patterns: Patterns, terms: np.ndarray) -> np.ndarray:
    """Features of one motion, window by window, as their definition says."""
    path = terms.reshape(len(terms), -1).T @ np.cos(
        np.pi * np.arange(1, len(terms) + 1)[:, None] * np.linspace(0.0, 1.0, 32)
    )
    found = []
    for piece, spacing, is_shape, limit in zip(*vars_of(patterns), strict=True):
        distances = []
        for place in range(32 - (LENGTH - 1) * spacing):
            window = path[:, place : place + LENGTH * spacing : spacing][:, :LENGTH]
            if is_shape:
                window = window - window.mean(axis=1, keepdims=True)
                window = window / window.std(axis=1, keepdims=True)
            distances.append(np.linalg.norm(window - piece))
        d = np.array(distances)
        weights = np.exp(-(d**2 - d.min() ** 2) / (2 * limit**2))
        where = (np.arange(len(d)) * weights).sum() / weights.sum()
        found.append((d.min(), np.log(weights.sum()), where))
    return np.array(found).T.ravel()


def vars_of(patterns: Patterns) -> tuple[list[np.ndarray], list[int], list[bool], list[float]]:
    return (
        list(patterns.pieces),
        patterns.spacings.tolist(),
        patterns.is_shape.tolist(),
        patterns.limits.tolist(),
    )


def test_they_are_those_of_each_window_by_itself() -> None:
    patterns = learn_patterns(_terms(4), np.array([0, 0, 1, 1]), seed=0)
    for terms in _terms(3, seed=1):
        found = patterns.features(terms[None])[0]
        np.testing.assert_allclose(found, _one_by_one(patterns, terms), rtol=1e-9, atol=1e-9)


def test_one_motion_of_a_class_and_one_motion_at_all() -> None:
    assert np.isfinite(learn_patterns(_terms(2), np.array([0, 1]), seed=0).limits).all()
    assert np.isfinite(learn_patterns(_terms(1), np.array([0]), seed=0).limits).all()


def test_names_and_numbers_go_there_and_back() -> None:
    assert not len(no_patterns())
    assert len(pattern_names(2)) == 2 * len(MEASURES)
    assert pattern_names(2)[:2] == ["pattern 1 nearest", "pattern 2 nearest"]
    patterns = learn_patterns(_terms(3), np.array([0, 0, 1]), seed=0)
    again = Patterns.of_arrays(patterns.arrays)
    np.testing.assert_array_equal(again.features(_terms(2)), patterns.features(_terms(2)))
    pieces, spacings, is_shape, limits = patterns.arrays
    with pytest.raises(ValueError, match="cannot be looked for"):
        Patterns.of_arrays((pieces, spacings + 0.5, is_shape, limits))


def _gesture(first: float, second: float, rng: np.random.Generator) -> MeshSequence:
    """Move a curve at two places in turn, each when it likes."""
    s, t = np.linspace(0.0, 1.0, 11), np.linspace(0.0, 1.0, 30)[:, None]
    frames = np.repeat(np.stack([s, 0.3 * np.sin(np.pi * s), 0 * s], axis=1)[None], 30, axis=0)
    for when, where in ((0.33, first), (0.66, second)):
        time = np.exp(-0.5 * ((t - when - rng.normal(0.0, 0.06)) / 0.09) ** 2)
        frames[:, :, 1] += 0.15 * time * np.exp(-0.5 * ((s - where) / 0.16) ** 2)
    vertices = 100.0 * (frames + rng.normal(0.0, 0.01, frames.shape))
    return mesh_sequence(vertices, topology="open curve", unit="mm")


def test_a_model_of_gestures_keeps_its_patterns() -> None:
    rng = np.random.default_rng(5)
    ways = {"back": (0.8, 0.35), "forth": (0.35, 0.8), "twice": (0.8, 0.75)}
    cases = [
        TrainingCase(_gesture(*where, rng), label, f"person {k}")
        for label, where in ways.items()
        for k in range(8)
    ]
    model = train(cases, "gestures", TrainingOptions(repetitions=1, card="quick"))
    readers = [member.reader for member in model.members]
    assert any(reader.patterns is not None for reader in readers)
    again = model_from_hdf5(model_to_hdf5(model))
    assert again.id == model.id
    for label, where in ways.items():
        motion = _gesture(*where, rng)
        answer = classify(motion, again)
        assert answer.label == label
        np.testing.assert_array_equal(answer.probabilities, classify(motion, model).probabilities)
    # What is looked for decides what is found.
    of_patterns = next(m for m in model.members if m.reader.patterns is not None)
    patterns = of_patterns.reader.patterns
    assert patterns is not None
    other = replace(patterns, limits=2.0 * patterns.limits)
    changed = tuple(
        replace(m, reader=replace(m.reader, patterns=other)) if m is of_patterns else m
        for m in model.members
    )
    assert replace(model, members=changed).id != model.id
