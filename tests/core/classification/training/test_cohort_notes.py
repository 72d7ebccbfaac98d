"""Labels, subjects and units that look like a slip are noted."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import pytest
from classify_samples import cohort

from modalmotion.classification.features import Further
from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.training.case_row import CaseRow
from modalmotion.classification.training.cases import TrainingCase
from modalmotion.classification.training.cohort_notes import SUBJECT_NOTE, cohort_notes
from modalmotion.classification.training.collection import collect
from modalmotion.errors import ParameterError


@cache
def rows() -> tuple[CaseRow, ...]:
    return collect(cohort(6), TrainingOptions()).rows


def relabelled(label: str, n: int = 1) -> list[CaseRow]:
    """Label the first of the normal cases anew."""
    return [
        replace(row, label=label, name=f"n{k}.npz") if k < n else row
        for k, row in enumerate(sorted(rows(), key=lambda row: row.label != "normal"))
    ]


def test_a_cohort_without_slips_has_no_notes() -> None:
    assert cohort_notes(rows()) == ()
    assert cohort_notes(relabelled("dyskinesia")) == ()


@pytest.mark.parametrize("n", [1, 2])
def test_classes_that_differ_in_case_alone(n: int) -> None:
    (note,) = cohort_notes(relabelled("Normal", n))
    assert note.startswith("The class 'Normal' differs from 'normal' in case alone: case n0.npz")
    (note,) = cohort_notes(relabelled("normal ", n))
    assert "in blanks alone" in note


def test_a_class_of_one_case_that_is_nearly_another() -> None:
    (note,) = cohort_notes(relabelled("nromal"))
    assert note.startswith("The class 'nromal' has one case, n0.npz, and is spelt nearly as 'norm")
    assert cohort_notes(relabelled("nromal", 2)) == ()
    numbered = [replace(row, label=row.label + " 1") for row in relabelled("normal")]
    assert cohort_notes([replace(numbered[0], label="normal 2"), *numbered[1:]]) == ()


def test_recordings_without_subjects() -> None:
    without = [replace(row, subject=None) for row in rows()]
    assert cohort_notes(without) == (SUBJECT_NOTE,)
    assert cohort_notes([*without[1:], rows()[0]]) == ()
    cases = [TrainingCase(case.motion, case.label) for case in cohort(3)]
    assert SUBJECT_NOTE in collect(cases, TrainingOptions()).notes


def test_subjects_that_are_numbered_anew_in_each_class() -> None:
    seen: dict[str, int] = {}
    anew = []
    for row in rows():
        seen[row.label] = seen.get(row.label, 0) + 1
        anew.append(replace(row, subject=str(seen[row.label])))
    (note,) = cohort_notes(anew)
    assert note.startswith("6 of 6 subjects have recordings of several classes")
    # Few were recorded in several states, and some have no id: that is no numbering.
    apart = [replace(row, subject=f"{row.label} {row.subject}") for row in anew]
    assert cohort_notes(apart) == ()
    assert cohort_notes([*apart[:-2], *anew[:1], *anew[-1:]]) == ()


@pytest.mark.parametrize("named", [True, False])
def test_one_recording_with_two_labels_is_named_by_its_files(named: bool) -> None:
    first, *rest = cohort(2)
    names = ("a.npz", "b.npz") if named else ("", "")
    other = next(case.label for case in rest if case.label != first.label)
    twice = [replace(first, name=names[0]), replace(first, name=names[1], label=other)]
    with pytest.raises(ParameterError) as caught:
        collect([*twice, *rest], TrainingOptions())
    start = "a.npz and b.npz are one recording, which has" if named else "The recording "
    assert str(caught.value).startswith(start)
    assert f"two classes, {first.label!r} and {other!r}" in str(caught.value)


@pytest.mark.parametrize("times", [1e-3, 1e3])
def test_a_size_far_from_the_others(times: float) -> None:
    first, *rest = relabelled("normal")
    further = {
        key: values + math.log(times) if key.kind == Further.SIZE else values
        for key, values in first.further.items()
    }
    (note,) = cohort_notes([replace(first, further=further), *rest])
    # Ventricles differ in size themselves.
    name, _, more = note.partition(" is ")
    assert name == "n0.npz"
    assert more.endswith("times as large as the others: check its unit.")
    assert 0.5 < float(more.split()[0]) / times < 2
