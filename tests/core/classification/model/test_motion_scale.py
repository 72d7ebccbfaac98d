"""Motions that would be usual if they were several times smaller."""

from __future__ import annotations

import math

import numpy as np
import pytest

from modalmotion.classification.model.motion_scale import FACTORS, MotionScale

# Narrow ones that move four times as much as others of their shape, far from one another.
STRONGER = np.array([[math.log(4.0) / 0.25, x, y] for x, y in ((0, -1), (-1, 0.6), (1, 0.6))])


def hearts(n: int, rng: np.random.Generator) -> np.ndarray:
    """Half of them narrow and strong, half of them wide and a third as strong."""
    is_weak = np.arange(n) % 2
    motion = rng.normal(0.0, 0.6, n) - is_weak * math.log(3.0) / 0.25
    shapes = rng.normal(0.0, 0.6, (n, 2)) + 4.0 * is_weak[:, None]
    return np.column_stack([motion, shapes])


def test_a_weak_heart_three_times_as_strong_is_found(rng: np.random.Generator) -> None:
    known, new = MotionScale(hearts(600, rng), 0.25), hearts(200, rng)
    assert np.mean([known.exceeds(place) for place in new]) <= 0.02
    step = np.array([math.log(3.0) / 0.25, 0.0, 0.0])
    larger = new + step
    assert np.mean([known.exceeds(place) for place in larger[1::2]]) > 0.95
    # Three times too small is another matter.
    assert not any(known.exceeds(place) for place in new - step)


def test_the_evidence_is_that_of_the_densities(rng: np.random.Generator) -> None:
    points, places = hearts(40, rng), hearts(3, rng)

    def density(place: np.ndarray) -> float:
        squares = [sum((a - b) ** 2 for a, b in zip(place, point, strict=True)) for point in points]
        return sum(math.exp(-square / 0.32) for square in squares) / len(points) + 1e-9

    expected = [
        math.log(max(density(x - [math.log(f) / 0.25, 0.0, 0.0]) for f in FACTORS) / density(x))
        for x in places
    ]
    found = MotionScale(points, 0.25).evidence(places)
    assert found == pytest.approx(expected, rel=1e-9)
    assert MotionScale(points, 0.25).evidence(np.full((1, 3), 99.0)) == pytest.approx([0.0])


@pytest.mark.parametrize("apart", [1e-4, 0.2])
def test_a_recording_does_not_vouch_for_itself_nor_for_its_other_form(
    rng: np.random.Generator, apart: float
) -> None:
    points = hearts(500, rng)
    points[:6:2] = STRONGER
    once = MotionScale(points, 0.25)
    twice = MotionScale(np.concatenate([points, points + apart]), 0.25)
    assert once.limit > 10.0
    assert twice.limit == pytest.approx(once.limit, abs=0.5)


def test_what_training_cases_do_too_is_not_too_large(rng: np.random.Generator) -> None:
    points = hearts(500, rng)
    points[:6:2] = STRONGER
    known = MotionScale(points, 0.25)
    place = np.array([math.log(2.0) / 0.25, 0.0, 0.0])
    assert 0.0 < known.evidence(place[None])[0] < known.limit
    assert not known.exceeds(place)
    assert MotionScale(hearts(500, rng), 0.25).exceeds(place)


def test_few_training_cases_say_nothing(rng: np.random.Generator) -> None:
    few = MotionScale(hearts(100, rng), 0.25)
    assert few.limit == np.inf
    assert not few.exceeds(np.array([0.0, 4.0, 4.0]))
    assert MotionScale(hearts(600, rng), np.inf).limit == np.inf
