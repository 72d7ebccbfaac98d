"""A cohort whose recordings look like several topologies is read in one basis."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from bent_surfaces import bent_beat, bent_cohort

from modalmotion.classification import (
    Model,
    TrainingCase,
    TrainingOptions,
    classify,
    evaluate,
    train,
)
from modalmotion.errors import TopologyError, UnlikeCasesError
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.simulate import simulate_ventricle


def quick(topology: str | None = None) -> TrainingOptions:
    return TrainingOptions(
        folds=2,
        estimator="linear",
        topology=topology,
        kind="material",
        repetitions=1,
        card="quick",
    )


def cases(n_per_class: int, seed: int) -> list[TrainingCase]:
    return [
        TrainingCase(sequence, label, f"{seed}-{number}", name=f"case-{number}.npz")
        for number, (sequence, label) in enumerate(bent_cohort(n_per_class, seed))
    ]


@cache
def model_of(topology: str | None) -> Model:
    return train(cases(8, 1), "bent", quick(topology))


def test_alone_they_have_two_topologies() -> None:
    parameters = TrainingOptions().signature_parameters
    surfaces = {modal_signature(s, parameters).surface for s, _ in bent_cohort(2, 1)}
    assert surfaces == {"sphere", "mesh"}


@pytest.mark.thorough
def test_together_they_have_the_spring_modes_of_their_mesh_and_the_model_says_so() -> None:
    model = model_of(None)
    assert model.readable.topologies == ("mesh",)
    assert not model.signature_parameters.closed_form
    assert any("fitted with its spring modes" in note for note in model.card.notes)


@pytest.mark.every(3)
@pytest.mark.parametrize("topology", [None, "sphere", "mesh"])
def test_a_model_imposes_its_basis_on_what_is_classified(topology: str | None) -> None:
    """Sequences of any bend get an answer, with nothing said again."""
    model = model_of(topology)
    assert model.readable.topologies == (topology or "mesh",)
    result = evaluate(model, cases(6, 2))
    assert result.abstained <= 0.1
    if topology != "sphere":
        assert result.accuracy >= 0.9


def test_a_bent_surface_is_read_by_a_model_of_straight_ones_where_it_can_be() -> None:
    rng = np.random.default_rng(5)
    straight = [TrainingCase(bent_beat(label, 0.3, rng), label) for label in ("strong", "weak") * 6]
    model = train(straight, "straight", quick())
    assert model.readable.topologies == ("sphere",)
    answer = classify(bent_beat("strong", 3.3, rng), model)
    # It may be unlike the others, and is not refused for the word.
    assert not any("topology" in note for note in answer.notes)
    stated = bent_beat("strong", 0.3, rng)
    assert classify(stated, model).label is not None


def test_signatures_that_do_not_compare_are_refused_by_name_with_the_way() -> None:
    fitted = [case.fitted(SignatureParameters(reference="mean")) for case in cases(4, 1)]
    with pytest.raises(UnlikeCasesError, match=r"case case-2\.npz") as caught:
        train(fitted, "refused")
    assert "give the sequences themselves" in caught.value.remedy


def test_sequences_of_several_meshes_that_do_not_compare_are_refused_by_name() -> None:
    sequence, label = next(iter(bent_cohort(1, 1)))
    # The same surface with other numbers: another mesh.
    order = np.random.default_rng(3).permutation(sequence.n_vertices)
    faces = np.argsort(order)[sequence.faces]
    other = mesh_sequence(sequence.vertices[:, order], faces=faces, unit="mm")
    with pytest.raises(UnlikeCasesError, match="odd one"):
        train([*cases(4, 1), TrainingCase(other, label, name="odd one")], "refused")


@pytest.mark.every(3)
@pytest.mark.parametrize("kind", [None, "material", "offset"])
def test_a_surface_of_another_topology_is_named_and_the_way_to_go_on_works(
    kind: str | None,
) -> None:
    rng = np.random.default_rng(5)
    closed = [
        TrainingCase(bent_beat(label, 0.3, rng), label, name=f"closed {k}.npz")
        for k, label in enumerate(("strong", "weak") * 4)
    ]
    cup = simulate_ventricle(n_vertices=300, rng=rng)
    # The first is the odd one: all others differ from it.
    odd = TrainingCase(replace(cup, topology=None), "strong", name="open.npz")
    options = replace(quick(), kind=kind)
    with pytest.raises(UnlikeCasesError) as caught:
        train([odd, *closed], "refused", options)
    assert "(1: open.npz)" in caught.value.remedy
    assert "--skip-unreadable" in caught.value.remedy
    model = train([odd, *closed], "most", replace(options, on_error="leave out"))
    assert model.readable.topologies == ("sphere",)
    assert any("open.npz" in note for note in model.card.notes)


def test_a_stated_topology_is_the_only_one_that_is_tried() -> None:
    with pytest.raises(TopologyError, match=r"case-0\.npz: .*cup"):
        train(cases(2, 1), "refused", quick("cup"))
