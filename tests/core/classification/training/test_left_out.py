"""A cohort goes on without the cases that do not fit, if its sender says so."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from bent_surfaces import bent_beat, bent_cohort
from classify_samples import cohort

from modalmotion.classification import TrainingCase, TrainingOptions, train
from modalmotion.classification.training.cases import AnyCase
from modalmotion.classification.training.left_out import LeftOut, left_out_notes
from modalmotion.errors import MalformedFileError, ParameterError, StoreError, UnlikeCasesError
from modalmotion.mesh.sequence import mesh_sequence

RAISES = TrainingOptions(estimator="linear", folds=2, repetitions=1, card="quick", kind="material")
GOES_ON = replace(RAISES, on_error="leave out")


@dataclass(frozen=True)
class Broken:
    """A source that cannot be read."""

    name: str = "scans/broken.npz"
    error: Any = None

    def read(self) -> TrainingCase:
        raise self.error or MalformedFileError(f"{self.name}: It ends in the middle.")


def spheres(n: int = 3) -> list[TrainingCase]:
    """Closed surfaces, half of them bent, on one mesh."""
    return [
        TrainingCase(sequence, label, name=f"case-{number}.npz")
        for number, (sequence, label) in enumerate(bent_cohort(n, 1))
    ]


@pytest.mark.parametrize("place", [0, 3])
def test_a_case_that_cannot_be_read_is_left_out_by_its_name(place: int) -> None:
    whole = cohort(3)
    some: list[AnyCase] = [*whole[:place], Broken(), *whole[place:]]
    with pytest.raises(MalformedFileError, match="broken"):
        train(some, "small", RAISES)
    model = train(some, "small", GOES_ON)
    assert model.card.notes[:2] == (
        "Cases left out: 1.",
        "Left out: scans/broken.npz: It ends in the middle.",
    )
    assert model.id == train(whole, "small", RAISES).id


def test_a_still_one_and_one_without_a_label_are_left_out() -> None:
    still = mesh_sequence(np.zeros((1, 4, 3)), grid=(2, 2), topology="cup")
    some = [
        *cohort(3),
        TrainingCase(still, "normal", name="still.npz"),
        TrainingCase(cohort(4)[-1].motion, " ", name="nameless.npz"),
    ]
    notes = train(some, "small", GOES_ON).card.notes
    assert notes[0] == "Cases left out: 2."
    assert notes[1].startswith("Left out: still.npz: ")
    assert notes[2].startswith("Left out: nameless.npz: ")


@pytest.mark.every(2)
@pytest.mark.parametrize("place", [0, 4])
def test_one_of_another_mesh_is_left_out_wherever_it_stands(place: int) -> None:
    """All others compare in the spring modes of their mesh, though some have a topology."""
    bent = bent_beat("strong", 3.0, np.random.default_rng(5))
    order = np.random.default_rng(6).permutation(bent.n_vertices)
    other = mesh_sequence(bent.vertices[:, order], np.argsort(order)[bent.faces], unit="mm")
    some = spheres()
    some.insert(place, TrainingCase(other, some[0].label, name="other-mesh.npz"))
    with pytest.raises(UnlikeCasesError):
        train(some, "bent", RAISES)
    model = train(some, "bent", GOES_ON)
    assert model.readable.topologies == ("mesh",)
    assert [note for note in model.card.notes if note.startswith("Left out")] == [
        "Left out: other-mesh.npz: Its modes do not compare with those of most."
    ]
    assert model.id == train(spheres(), "bent", RAISES).id


def test_a_class_that_is_left_out_whole_is_told() -> None:
    some: list[AnyCase] = [*(case for case in cohort(3) if case.label == "normal"), Broken()]
    with pytest.raises(ParameterError, match=r"1 class\(es\), without the 1 that were left out"):
        train(some, "small", GOES_ON)


def test_a_fault_of_the_disk_is_no_fault_of_a_case() -> None:
    with pytest.raises(StoreError, match="full"):
        train([*cohort(3), Broken(error=StoreError("The disk is full."))], "small", GOES_ON)


def test_a_card_names_so_many_and_counts_the_rest() -> None:
    assert left_out_notes([]) == ()
    notes = left_out_notes([LeftOut(f"{k}.npz", "No.") for k in range(25)])
    assert notes[0] == "Cases left out: 25."
    assert notes[-1] == "Left out besides: 5 cases that this list is too short for."
    assert len(notes) == 22
