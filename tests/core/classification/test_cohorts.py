"""Small cohorts of any kind: what tells the classes apart is found without an option."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from classify_samples import cohort
from scipy.spatial.transform import Rotation

from modalmotion.classification import (
    Model,
    TrainingCase,
    TrainingOptions,
    evaluate,
    model_from_hdf5,
    model_to_hdf5,
    train,
)
from modalmotion.classification.training import fold_fit
from modalmotion.classification.training.case_groups import inner_groups
from modalmotion.classification.training.collection import collect
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topology import CYLINDER
from modalmotion.signature.making import modal_signature
from modalmotion.simulate import simulate_ventricle


def turned(vertices: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    moved: np.ndarray = vertices @ Rotation.random(random_state=rng).as_matrix().T
    return moved + rng.normal(0.0, 50.0, 3)


def word(label: str, rng: np.random.Generator) -> MeshSequence:
    """A curve that rises at two places one after the other, and comes to rest again."""
    s = np.linspace(0.0, 1.0, 12)
    t = np.linspace(0.0, 1.0, int(rng.integers(20, 40)))
    first, second = (0.8, 0.3) if label == "tip first" else (0.3, 0.8)
    vertices = np.repeat(np.stack([60 * s, 20 * s**2, 0 * s], axis=1)[None], len(t), axis=0)
    for when, where in ((0.35, first), (0.65, second)):
        time = np.exp(-(((t - when - rng.normal(0.0, 0.03)) / 0.12) ** 2))
        lift = rng.uniform(6.0, 10.0) * np.outer(time, np.exp(-(((s - where) / 0.2) ** 2)))
        vertices[:, :, 1] += lift
    vertices += 0.3 * rng.standard_normal(vertices.shape)
    return mesh_sequence(turned(vertices, rng), topology="open curve", unit="mm")


def ring(label: str, rng: np.random.Generator) -> MeshSequence:
    """A torus on which a wave runs round, one way or the other, starting anywhere."""
    grid = (8, 12)
    a, b = np.meshgrid(*(2 * np.pi * np.arange(n) / n for n in grid), indexing="ij", sparse=False)
    a, b = a.ravel(), b.ravel()
    n_frames = int(rng.integers(12, 24))
    phase = 2 * np.pi * (np.arange(n_frames) / n_frames + rng.uniform())
    sense = 1.0 if label == "forwards" else -1.0
    wide = 30.0 + 10.0 * np.cos(a)
    vertices = np.empty((n_frames, len(a), 3))
    vertices[:, :, 0], vertices[:, :, 1] = wide * np.cos(b), wide * np.sin(b)
    wave = np.cos(2 * (b - rng.uniform(0.0, 6.28)) - sense * phase[:, None])
    vertices[:, :, 2] = 10.0 * np.sin(a) + rng.uniform(2.0, 4.0) * wave
    vertices += 0.5 * rng.standard_normal(vertices.shape)
    return mesh_sequence(turned(vertices, rng), grid=grid, topology="torus", unit="mm")


def bulge(label: str, rng: np.random.Generator) -> MeshSequence:
    """A sheet that bulges more or less, each somewhere else."""
    s, u = np.meshgrid(np.linspace(0, 60, 9), np.linspace(0, 70, 10), indexing="ij")
    rest = np.stack([s.ravel(), u.ravel(), np.zeros(90)], axis=1)
    n_frames = int(rng.integers(12, 24))
    phase = 2 * np.pi * (np.arange(n_frames) / n_frames + rng.uniform())
    apart = np.linalg.norm(rest[:, :2] - rng.normal((30, 35), 8.0), axis=1)
    size = {"less": 4.0, "more": 6.0}[label] * np.exp(rng.normal(0.0, 0.1))
    vertices = np.repeat(rest[None], n_frames, axis=0)
    vertices[:, :, 2] += size * np.outer(np.cos(phase), np.exp(-0.5 * (apart / 15.0) ** 2))
    vertices += 0.3 * rng.standard_normal(vertices.shape)
    return mesh_sequence(turned(vertices, rng), grid=(9, 10), topology="plane", unit="mm")


KINDS: dict[object, tuple[str, str]] = {
    word: ("tip first", "back first"),
    ring: ("forwards", "backwards"),
    bulge: ("less", "more"),
}


def cases(kind: object, n_per_class: int, seed: int) -> list[TrainingCase]:
    rng = np.random.default_rng(seed)
    assert callable(kind)
    return [
        TrainingCase(modal_signature(kind(label, rng)), label, f"{seed} {number}")
        for number in range(n_per_class)
        for label in KINDS[kind]
    ]


@cache
def trained(kind: object) -> Model:
    options = TrainingOptions(folds=2, repetitions=1, card="quick")
    return train(cases(kind, 14, seed=1), "cohort", options)


@pytest.mark.every(3)
@pytest.mark.parametrize(("kind", "least"), [(word, 0.9), (ring, 0.9), (bulge, 0.75)])
def test_order_sense_and_amplitude_are_learned(kind: object, least: float) -> None:
    found = evaluate(trained(kind), cases(kind, 12, seed=2))
    assert found.accuracy >= least


def test_the_card_says_what_is_read() -> None:
    for kind in KINDS:
        model = trained(kind)
        said = model.card.options["features"]
        assert [share for _, share in said] == [round(m.weight, 3) for m in model.members]
        for (words, _), member in zip(said, model.members, strict=True):
            reader = member.reader
            if reader.reads_motion:
                assert ("cycle" in words) == reader.is_cycle
                assert ("few" in words) == reader.is_brief
            assert all(str(further) in words for further in reader.further)


def test_a_stated_timing_leaves_no_choice() -> None:
    words = cases(word, 3, seed=5)
    for timing in ("cycle", "course"):
        readers = collect(words, TrainingOptions(timing=timing)).readers
        assert {reader.is_cycle for reader in readers} == {timing == "cycle"}
    assert {reader.is_cycle for reader in collect(words, TrainingOptions()).readers} == {
        True,
        False,
    }


def test_cups_and_cylinders_together_are_read_about_their_axis_only() -> None:
    signature = modal_signature(replace(simulate_ventricle(grid=(12, 24)), topology=CYLINDER))
    mixed = [*cohort(6), TrainingCase(signature, "normal", "other")]
    readers = collect(mixed, TrainingOptions()).readers
    assert readers
    assert all(reader.has_axis and not reader.adds_modes for reader in readers)


def test_many_cases_are_compared_on_some_and_fitted_to_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    table = collect(cases(bulge, 14, seed=1), TrainingOptions())
    rows = np.arange(len(table))
    monkeypatch.setattr(fold_fit, "_MOST_COMPARED", 14)
    monkeypatch.setattr(fold_fit, "_FEWEST_COMPARED", 3)
    found = fold_fit.fit_rows(table, rows, TrainingOptions())
    for member in found.members:
        assert len(member.X) == len(member.estimator.losses_) == len(rows)


def test_a_class_of_one_subject_is_left_out_case_by_case() -> None:
    y = np.array([0, 0, 0, 1, 1, 1, 1])
    groups = np.array([3, 3, 3, 0, 0, 1, 1])
    found = inner_groups(y, groups)
    assert len(set(found[:3].tolist())) == 3
    assert np.array_equal(found[3:], groups[3:])
    assert not set(found[:3].tolist()) & set(found[3:].tolist())


def test_a_model_of_modes_comes_back_from_its_file() -> None:
    again = model_from_hdf5(model_to_hdf5(trained(bulge)))
    assert again.id == trained(bulge).id
    readers = [[m.reader.description for m in model.members] for model in (again, trained(bulge))]
    assert readers[0] == readers[1]
