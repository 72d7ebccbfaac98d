"""Cohorts: one basis for all, subjects together, what does not fit named or left out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from classify_samples import cohort, curve, curves

import modalmotion as mm
from modalmotion.classification import TrainingCase, TrainingOptions
from modalmotion.classification.cohort import Cohort, collect_cohorts, conditions_of
from modalmotion.errors import ParameterError, UnlikeCasesError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.simulate import simulate_ventricle


class Broken:
    """A file that cannot be read."""

    name = "broken.npz"

    def read(self) -> TrainingCase:
        raise ParameterError("broken.npz: nothing in it.")


def collected(cases: list[Any], **options: Any) -> Cohort:
    return collect_cohorts(cases, None, TrainingOptions(kind="material", **options))[0]


def ventricles(n: int, **stated: Any) -> Iterator[TrainingCase]:
    for k in range(n):
        rng = np.random.default_rng(k)
        beat = simulate_ventricle(grid=(6, 12))
        moved = beat.vertices + 0.2 * rng.standard_normal(beat.vertices.shape)
        yield TrainingCase(replace(beat, vertices=moved, **stated), "ab"[k % 2], name=f"{k}.npz")


def test_where_shapes_are_of_several_topologies_all_are_read_in_those_that_all_allow() -> None:
    cases = [*ventricles(3, topology=None, grid=None), *ventricles(4, topology=mm.CYLINDER)][:6]
    both = collect_cohorts(cases, None, TrainingOptions(kind="material", modes=7))
    assert {one.readable.topology for one in both} <= {"cup", "cylinder", "mesh"}
    assert all(len(one) == 6 for one in both)


def test_what_compares_in_no_way_is_named_with_a_remedy() -> None:
    rng = np.random.default_rng(1)
    mixed = [*ventricles(4), TrainingCase(curve("tip", rng), "a", name="tip.npz")]
    with pytest.raises(UnlikeCasesError, match=r"tip\.npz") as refused:
        collected(mixed)
    assert "--topology sphere" in refused.value.remedy
    left = collected([*mixed, Broken()], on_error="leave out")
    assert len(left) == 4
    assert any("broken.npz" in note for note in left.notes)
    assert any("tip.npz" in note for note in left.notes)


def test_a_broken_file_ends_a_training_that_does_not_leave_it_out() -> None:
    with pytest.raises(ParameterError, match=r"broken\.npz"):
        collected([*curves(3), Broken()])


def test_subjects_and_what_shares_a_group_stay_together() -> None:
    sites = "AABBCC"
    cases = [
        replace(case, subject=f"s{k // 2}", covariates={"site": sites[k % 6]})
        for k, case in enumerate(cohort(6))
    ]
    plain = collected(cases)
    assert len(set(plain.groups)) == 6
    assert plain.groups[0] == plain.groups[1] != plain.groups[2]
    assert len(set(collected(cases, groups="site").groups)) == 3
    with pytest.raises(ParameterError, match="which none of the cases has"):
        collected(cases, groups="ward")


def test_as_many_modes_are_read_as_all_have() -> None:
    rng = np.random.default_rng(2)
    few = [TrainingCase(curve(label, rng), label) for label in ("tip", "back") * 3]
    coarse = few[0].motion
    assert isinstance(coarse, MeshSequence)
    thin = replace(coarse, vertices=coarse.vertices[:, :8])
    cohort_ = collected([*few, TrainingCase(thin, "tip")])
    assert cohort_.readable.n_modes < 10
    assert {len(motion.modes) for motion in cohort_.motions} == {cohort_.readable.n_modes}


def test_conditions_are_what_is_known_beside_the_motion() -> None:
    case = next(ventricles(1))
    assert isinstance(case.motion, MeshSequence)
    motion = replace(case.motion, facts=replace(case.motion.facts, covariates={"age": 61}))
    signature = TrainingCase(motion, "a").fitted(TrainingOptions().signature_parameters).signature
    found = conditions_of(signature)
    assert found["frames"] == 25
    assert found["age"] == 61
    assert found["modality"] == "simulated"
    assert float(found["frame rate"]) == pytest.approx(
        24 / np.asarray(signature.times)[-1], rel=0.01
    )


def test_the_hash_does_not_depend_on_the_order() -> None:
    assert collected(curves(3)).hash == collected(curves(3)[::-1]).hash
    assert collected(curves(3)).hash != collected(curves(4)).hash
