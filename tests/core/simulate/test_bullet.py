"""Ventricles of another make: they eject what they should, and each class has what defines it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modalmotion.mesh import Cavity
from modalmotion.simulate import MotionClass
from modalmotion.simulate.bullet import bullet_cohort, draw_bullet, simulate_bullet


def ejected(parameters: object, n_frames: int = 48) -> float:
    beat = simulate_bullet(parameters, n_frames, 0.0, 0.0, np.random.default_rng(1))  # type: ignore[arg-type]
    volumes = Cavity(beat.faces).volume(beat.vertices.astype(np.float64))
    return float(1.0 - volumes.min() / volumes[0])


@pytest.mark.parametrize("label", list(MotionClass))
def test_the_whole_ejects_what_it_should_and_a_lost_wall_is_missing(label: MotionClass) -> None:
    drawn = draw_bullet(label, np.random.default_rng(2))
    whole = replace(drawn, lost=0.0)
    assert ejected(whole) == pytest.approx(drawn.ejection_fraction, abs=0.02)
    if label == MotionClass.AKINESIA:
        assert ejected(drawn) < drawn.ejection_fraction - 0.005


def test_classes_have_what_defines_them() -> None:
    rng = np.random.default_rng(3)
    drawn = {label: [draw_bullet(label, rng) for _ in range(40)] for label in MotionClass}
    assert max(p.ejection_fraction for p in drawn[MotionClass.HYPOKINESIA]) <= 0.5
    assert min(p.ejection_fraction for p in drawn[MotionClass.NORMAL]) >= 0.54
    assert max(p.twist for p in drawn[MotionClass.REDUCED_TORSION]) <= 5.0
    assert min(p.lag for p in drawn[MotionClass.DYSSYNCHRONY]) >= 0.055
    assert min(p.lost for p in drawn[MotionClass.AKINESIA]) >= 0.5


def test_the_same_generator_gives_the_same_cohort_of_closed_cups() -> None:
    first, second = (
        list(bullet_cohort(1, rng=np.random.default_rng(4), n_frames=(8, 10))) for _ in range(2)
    )
    assert [label for _, label in first] == list(MotionClass)
    for (one, _), (other, _) in zip(first, second, strict=True):
        assert one.id == other.id
        assert (Cavity(one.faces).volume(one.vertices.astype(np.float64)) > 0).all()
        assert str(one.topology) == "cup"
