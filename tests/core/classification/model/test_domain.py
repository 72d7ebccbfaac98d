"""What is no ventricle's beat gets no class, and nearly every held-out beat gets one."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from foreign_motions import FLAGGED, driven_by, figures, resting
from hypothesis import given
from hypothesis import strategies as st
from project import DATA

from modalmotion.classification import classify, evaluate, load_model
from modalmotion.classification.features import Column, Columns, kind_of
from modalmotion.classification.features.course import MEASURES
from modalmotion.classification.model.domain import CHECKS, OF_CLASS, Sights
from modalmotion.classification.training.train_shipped import (
    OFFSET,
    RECIPES,
    Recipe,
    held_out_cases,
)
from modalmotion.facts import Facts
from modalmotion.facts.facts import Tracking
from modalmotion.mesh.sequence import MeshSequence

KINDS = sorted(FLAGGED)
FIGURES = ["fox", "robot"]


def flagged(
    sequences: Iterable[MeshSequence], trackings: tuple[Tracking, ...] = ("material", "offset")
) -> float:
    """Share without a class, from either model."""
    found = [
        classify(sequence.with_facts(Facts(tracking=tracking, handedness="right")))
        for sequence in sequences
        for tracking in trackings
    ]
    for answer in found:
        assert (answer.label is None) == bool(answer.flags)
        assert answer.label is not None or answer.class_set == answer.classes
    return float(np.mean([answer.label is None for answer in found]))


def seen_by(kind: str) -> tuple[Tracking, ...]:
    """What must be stated of the points for a kind to be flagged."""
    # Along its normals a surface that grows and shrinks as a whole moves much as one that beats.
    return ("material",) if kind == "breathing" else ("material", "offset")


def windows(name: str) -> list[MeshSequence]:
    if not (DATA / name).is_dir():
        pytest.skip(f"{name}/ is not there: it is measured on, not shipped")
    return figures(name)


@pytest.mark.every(2)
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_beat_gets_no_class(kind: str) -> None:
    rng = np.random.default_rng(90)
    assert flagged((FLAGGED[kind](rng) for _ in range(2)), seen_by(kind)) == 1.0


@pytest.mark.every(2)
@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_gets_no_class_even_where_its_topology_is_that_of_a_ventricle(name: str) -> None:
    assert flagged(windows(name)[:1]) == 1.0
    rng = np.random.default_rng(91)
    driven = [driven_by(name, rng) for _ in range(2)]
    assert {sequence.topology.name for sequence in driven if sequence.topology} <= {
        "cup",
        "cylinder",
    }
    assert flagged(driven) >= 0.95


@pytest.mark.every(2)
@pytest.mark.parametrize("recipe", RECIPES.values(), ids=list(RECIPES))
def test_held_out_ventricles_get_a_class_and_mostly_the_right_one(recipe: Recipe) -> None:
    found = evaluate(load_model(recipe.name), held_out_cases(recipe, 4, seed=92))
    assert found.n_cases == 4 * len(recipe.classes)
    assert found.abstained <= 0.05
    assert found.accuracy > (0.8 if recipe is not OFFSET else 0.6)


@pytest.mark.soak
@pytest.mark.parametrize("kind", KINDS)
def test_hundreds_of_each_kind_get_no_class(kind: str) -> None:
    rng = np.random.default_rng(93)
    assert flagged((FLAGGED[kind](rng) for _ in range(300)), seen_by(kind)) >= 0.95


@pytest.mark.soak
@pytest.mark.parametrize("name", FIGURES)
def test_hundreds_of_parts_of_figures_get_no_class(name: str) -> None:
    assert flagged(windows(name)) >= 0.95
    rng = np.random.default_rng(94)
    assert flagged(driven_by(name, rng) for _ in range(300)) >= 0.95


@pytest.mark.soak
@pytest.mark.parametrize("recipe", RECIPES.values(), ids=list(RECIPES))
def test_two_thousand_held_out_ventricles_get_a_class(recipe: Recipe) -> None:
    found = evaluate(load_model(recipe.name), held_out_cases(recipe, 400, seed=95))
    assert found.n_cases == 400 * len(recipe.classes)
    assert found.abstained <= 0.05


def test_the_least_motion_is_of_the_size_and_not_in_mm(rng: np.random.Generator) -> None:
    # The same jitter in metres, on a ventricle of metres.
    shape = resting(rng)
    shaken = shape.vertices + rng.normal(0.0, 0.5, (12, *shape.vertices.shape[1:]))
    for factor, unit in ((1.0, "mm"), (1e-3, "m"), (1e3, "um")):
        still = replace(shape, vertices=factor * shaken, times=None, unit=unit)
        assert classify(still).flags == ("no motion",)


@given(
    values=st.lists(st.floats(-50.0, 50.0), min_size=3, max_size=3),
    motion=st.floats(1e-4, 1.0),
    larger=st.floats(0.1, 10.0),
)
def test_a_larger_motion_is_of_the_same_kind(
    values: list[float], motion: float, larger: float
) -> None:
    columns = Columns((Column("a", (0,)), Column("b", (1,)), Column("root", (2,), power=0.5)))
    powers = columns.powers
    one = kind_of(np.array([values]), np.array(motion), powers)
    grown = np.array([values]) * [larger, larger, np.sqrt(larger)]
    other = kind_of(grown, np.array(larger * motion), powers)
    # All readings of one motion have its size.
    assert np.allclose(kind_of(grown, larger * motion, powers), other, rtol=1e-12)
    assert one.shape == other.shape == (1, 4)
    assert np.allclose(one[:, :3], other[:, :3], rtol=1e-9, atol=1e-12)
    assert other[0, 3] - one[0, 3] == pytest.approx(np.log(larger), abs=1e-9)


def test_thousands_of_places_are_compared_in_bounded_memory(rng: np.random.Generator) -> None:
    places = rng.normal(size=(3_000, 3))
    places[::7, 1] = np.nan
    domain = replace(load_model().domain, points=rng.normal(size=(3_000, 3)))
    tracemalloc.start()
    found = domain.distance_from_places(places)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # All pairs at once are 216 MB.
    assert peak < 40e6
    some = [0, 7, 1_234, 2_999]
    alone = [float(domain.distance_from_places(places[k : k + 1])[0]) for k in some]
    assert found[some].tolist() == alone


def test_distances_are_of_the_class_and_in_its_own_spread(rng: np.random.Generator) -> None:
    model = load_model()
    domain = replace(model.domain, spreads=np.linspace(0.5, 1.5, len(model.classes)))
    kinds = rng.normal(size=(6, *domain.means[:1].shape)) + domain.means[:1]
    found = domain.distances(kinds[:, 0])
    for case in range(6):
        for k in range(len(model.classes)):
            own = (kinds[case, 0] - domain.means[k]) @ domain.whitening
            assert found[case, k] == pytest.approx(np.sqrt((own**2).sum()), rel=1e-12)
    assert domain.distance(kinds[:, 0]) == pytest.approx(found.min(axis=1), rel=1e-6)
    n = len(domain.directions)
    sights = Sights(
        kinds,
        np.ones((6, 1), dtype=np.bool_),
        np.ones((n, kinds.shape[2])),
        rng.normal(size=(6, len(MEASURES))),
    )
    judged = domain.judge(sights)
    assert judged.of_classes == pytest.approx(found / domain.spreads)
    y = np.array([0, 1, 2, 3, 4, 0])
    scores = judged.named(y)
    assert scores[:, OF_CLASS] == pytest.approx((found / domain.spreads)[np.arange(6), y])
    others = np.delete(np.arange(len(CHECKS)), OF_CLASS)
    assert np.array_equal(scores[:, others], judged.scores[:, others])


def test_no_motion_has_a_kind_that_is_a_number() -> None:
    kinds = kind_of(np.zeros((2, 3)), np.zeros(2), np.ones(3))
    assert np.isfinite(kinds).all()
    assert np.array_equal(kind_of(np.zeros((2, 3)), 0.0, np.ones(3)), kinds)
