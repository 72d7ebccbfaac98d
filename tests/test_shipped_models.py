"""The shipped models: what they answer, and the two makes of hearts that they are trained on."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import islice

import numpy as np
import pytest
from bullet import bullet_cohort, draw_bullet, simulate_bullet
from train_shipped import RECIPES, as_tracked, hearts, without_apex

import modalmotion as mm
from modalmotion.classification import (
    DEFAULT_MODEL,
    NORMAL_DISPLACEMENT_MODEL,
    TrainingCase,
    classify,
    load_model,
)
from modalmotion.mesh import Cavity
from modalmotion.simulate import MotionClass


@cache
def drawn(name: str) -> list[TrainingCase]:
    """All noises of the default model, of the other as many as have both makes and all classes."""
    n = None if name == DEFAULT_MODEL else 2 * len(RECIPES[name].classes)
    return list(islice(hearts(RECIPES[name], 3, 5, is_varied=True), n))


@pytest.mark.parametrize("name", list(RECIPES))
def test_hearts_of_both_makes_and_all_classes_are_drawn_alike_each_time(name: str) -> None:
    recipe, first = RECIPES[name], drawn(name)
    again = islice(hearts(recipe, 3, 5, is_varied=True), 6)
    assert [case.sequence_id for case in first[:6]] == [case.sequence_id for case in again]
    assert {case.name.split()[0] for case in first} == {"spheroid", "bullet"}
    assert {case.label for case in first} == set(map(str, recipe.classes))
    assert {case.signature.kind for case in first} == {recipe.options.kind}


def test_a_track_keeps_the_surface_and_little_of_its_noise() -> None:
    beat = mm.simulate_ventricle(grid=(12, 24))
    seen = as_tracked(beat, np.random.default_rng(1))
    apart = np.linalg.norm(seen.vertices - beat.vertices, axis=2)
    assert 0.05 < np.sqrt((apart**2).mean()) < 2.0
    cut = without_apex(beat, np.random.default_rng(3))
    assert cut.n_vertices <= beat.n_vertices
    assert str(cut.topology) == "cylinder"


@pytest.mark.parametrize("name", list(RECIPES))
def test_a_shipped_model_says_what_it_has_not_seen(name: str) -> None:
    model = load_model(name)
    assert model.classes == tuple(sorted(map(str, RECIPES[name].classes)))
    assert "Any patient" in model.card.has_not_seen
    assert model.card.extra["has_seen_patients"] is False
    assert model.card.extra["held_out"]["accuracy"] > 0.8
    assert any("has seen no patient" in note for note in model.notes[""])


def test_no_heart_of_a_preserved_ejection_fraction_is_called_globally_hypokinetic() -> None:
    model = load_model()
    for case in drawn(model.name):
        found = classify(case.signature, model)
        volumes = np.asarray(case.signature.volumes)
        if 1.0 - volumes.min() / volumes.max() > 0.55:
            assert found.label != MotionClass.HYPOKINESIA


def test_what_is_stated_as_a_cylinder_is_closed_to_a_cup_for_normal_displacements_alone() -> None:
    cut = without_apex(mm.simulate_ventricle(grid=(12, 24)), np.random.default_rng(3))
    found = classify(cut, load_model())
    assert found.flags == ("out of domain",)
    assert "State the topology if it is wrong" in found.notes[0]
    for other, name in (
        (replace(cut, topology=None), DEFAULT_MODEL),
        (cut, NORMAL_DISPLACEMENT_MODEL),
    ):
        assert classify(other, load_model(name)).label == "normal"


def test_a_healthy_heart_is_normal_whatever_its_pose() -> None:
    beat = mm.simulate_ventricle(
        mm.VentricleParameters(shape_variation=1.0, motion_variation=1.0),
        rng=np.random.default_rng(1),
    )
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    one = classify(beat)
    other = classify(replace(beat, vertices=beat.vertices @ turn.T + 40.0))
    assert one.label == other.label == "normal"
    assert one.probabilities == pytest.approx(other.probabilities, abs=1e-6)
    assert (Cavity(beat.faces).volume(beat.vertices.astype(np.float64)) > 0).all()


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
