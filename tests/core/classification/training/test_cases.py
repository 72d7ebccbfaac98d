"""Training cases carry what their senders know."""

from __future__ import annotations

from pathlib import Path

import pytest
from classify_samples import cohort

from modalmotion import Facts, SignatureParameters, modal_signature
from modalmotion.classification import CaseFile, TrainingCase, TrainingOptions, classify
from modalmotion.classification.answer import classifier
from modalmotion.classification.answer.readability import unreadable
from modalmotion.classification.model.model import Model
from modalmotion.classification.training.collection import collect
from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import ModalSignature
from modalmotion.simulate import simulate_ventricle
from modalmotion.store import signature_to_hdf5

BEAT = simulate_ventricle(grid=(6, 12)).with_facts(
    Facts(period=1.0, covariates={"age": 61, "sex": "f"})
)


def test_covariates_are_the_recordings_own_and_those_that_are_stated() -> None:
    case = TrainingCase(BEAT, "rest", covariates={"age": 62, "bsa": 1.9})
    stated = {"age": 62, "bsa": 1.9, "sex": "f"}
    assert case.covariates == stated
    assert case.motion.facts.period == 1.0
    assert case.sequence_id == BEAT.id
    fitted = case.fitted(SignatureParameters())
    assert fitted.covariates == fitted.signature.facts.covariates == stated
    assert TrainingCase(BEAT, "rest").covariates == {"age": 61, "sex": "f"}
    assert TrainingCase(BEAT, "rest").motion is BEAT


def test_a_covariate_that_is_none_is_refused() -> None:
    with pytest.raises(ParameterError, match="'age' is neither"):
        TrainingCase(BEAT, "rest", covariates={"age": float("nan")})


def test_covariates_of_a_case_in_a_file_stand_beside_the_file(tmp_path: Path) -> None:
    path = tmp_path / "signature.h5"
    signature = modal_signature(BEAT.with_facts(Facts()))
    path.write_bytes(signature_to_hdf5(signature))
    case = CaseFile(path, BEAT.id, "rest", covariates={"age": 61}).read()
    assert case.covariates == {"age": 61}


def test_covariates_reach_the_table_of_a_training() -> None:
    cases = [
        TrainingCase(case.motion, case.label, covariates={"age": 50 + k})
        for k, case in enumerate(cohort(3))
    ]
    table = collect(cases, TrainingOptions())
    assert [dict(one) for one in table.covariates] == [{"age": 50 + k} for k in range(len(cases))]


@pytest.mark.parametrize("is_fitted", [False, True])
def test_covariates_reach_the_model_that_is_asked(
    monkeypatch: pytest.MonkeyPatch, is_fitted: bool
) -> None:
    read: list[ModalSignature] = []

    def seen(signature: ModalSignature, model: Model) -> object:
        read.append(signature)
        return unreadable(signature, model)

    monkeypatch.setattr(classifier, "unreadable", seen)
    motion: MeshSequence | ModalSignature = BEAT
    if is_fitted:
        motion = modal_signature(BEAT)
    classify(motion, covariates={"age": 62})
    classify(motion)
    assert [dict(one.facts.covariates) for one in read] == [
        {"age": 62, "sex": "f"},
        {"age": 61, "sex": "f"},
    ]
