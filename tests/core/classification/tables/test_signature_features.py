"""Features of signatures in scikit-learn's form."""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import sklearn.utils.estimator_checks as checks
from bent_surfaces import bent_cohort
from classify_samples import cohort, curves
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.impute import SimpleImputer
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GridSearchCV, StratifiedKFold, cross_val_score
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from modalmotion.classification import MotionClassifier, SignatureFeatures, TrainingCase
from modalmotion.errors import InputError, ParameterError, UnlikeCasesError
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.simulate import MotionClass, simulate_cohort

MEAN = SignatureParameters(reference="mean")


@cache
def beats(n_per_class: int = 6, seed: int = 2) -> tuple[list[MeshSequence], list[str]]:
    classes = (MotionClass.NORMAL, MotionClass.HYPOKINESIA)
    cases = list(simulate_cohort(n_per_class, rng=np.random.default_rng(seed), classes=classes))
    return [case.sequence for case in cases], [str(case.label) for case in cases]


@cache
def signatures() -> list[ModalSignature]:
    return [modal_signature(sequence, MEAN) for sequence in beats()[0]]


def labels() -> list[str]:
    return beats()[1]


# Those that ask nothing of data, which are recordings here and no numbers.
WITHOUT_DATA = (
    checks.check_estimator_cloneable,
    checks.check_estimator_repr,
    checks.check_estimator_tags_renamed,
    checks.check_valid_tag_types,
    checks.check_do_not_raise_errors_in_init_or_set_params,
    checks.check_no_attributes_set_in_init,
    checks.check_parameters_default_constructible,
    checks.check_get_params_invariance,
    checks.check_set_params,
)


@pytest.mark.parametrize("check", WITHOUT_DATA, ids=lambda check: check.__name__)
def test_the_transformer_is_scikit_learns(check: Callable[..., None]) -> None:
    check("SignatureFeatures", SignatureFeatures())


def test_before_a_fit_there_is_nothing_to_read() -> None:
    with pytest.raises(NotFittedError):
        SignatureFeatures().transform(signatures())
    with pytest.raises(NotFittedError):
        SignatureFeatures().get_feature_names_out()


@pytest.mark.parametrize("kind", ["auto", "axis", "modes", "summary"])
@pytest.mark.parametrize("timing", ["auto", "cycle"])
def test_a_table_has_a_row_for_each_and_a_name_for_each_column(kind: str, timing: str) -> None:
    features = SignatureFeatures(kind=kind, timing=timing)
    table = features.fit_transform(signatures())
    names = features.get_feature_names_out()
    assert table.shape == (len(signatures()), len(names))
    assert table.dtype == np.float64
    assert np.isfinite(table).all()
    assert len(set(names)) == len(names)
    assert names.dtype == object
    # To the last bit, in one go, in two, again, and case by case.
    fitted = SignatureFeatures(kind=kind, timing=timing).fit(signatures(), labels())
    assert np.array_equal(fitted.transform(signatures()), table)
    assert np.array_equal(fitted.transform(signatures()[:3]), table[:3])
    assert np.array_equal(pickle.loads(pickle.dumps(fitted)).transform(signatures()), table)  # noqa: S301 (our own)


def test_a_course_and_the_terms_of_a_curve_are_read() -> None:
    some = [case.motion for case in curves(4)]
    for kind in ("modes", "summary", "terms"):
        table = SignatureFeatures(kind=kind, timing="course").fit_transform(some)
        assert np.isfinite(table).all()
    features = SignatureFeatures(kind="terms", timing="course").fit(some)
    assert any("direction" in name for name in features.get_feature_names_out())


@pytest.mark.thorough
def test_sequences_cases_and_signatures_give_the_same() -> None:
    sequences = beats()[0]
    table = SignatureFeatures().fit_transform(signatures())
    assert np.array_equal(SignatureFeatures().fit_transform(sequences), table)
    cases = [TrainingCase(sequence, "any") for sequence in sequences]
    fitted = SignatureFeatures().fit(cases)
    assert np.array_equal(fitted.transform(np.array(cases, dtype=object)), table)
    assert np.array_equal(fitted.transform(sequences), table)


def test_turned_and_moved_they_are_the_same() -> None:
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    fitted = SignatureFeatures().fit(signatures())
    moved = [
        replace(one, vertices=one.vertices @ turn.T + [5.0, -8.0, 100.0]) for one in beats()[0][:4]
    ]
    assert fitted.transform(moved) == pytest.approx(
        fitted.transform(beats()[0][:4]), rel=1e-6, abs=1e-6
    )


def test_a_pipeline_is_searched_cloned_and_validated() -> None:
    """One turn of the whole crank: what a user of scikit-learn does on the first day."""
    pipeline = Pipeline(
        [
            ("features", SignatureFeatures()),
            ("scale", StandardScaler()),
            ("class", MotionClassifier()),
        ]
    )
    folds = StratifiedKFold(3, shuffle=True, random_state=1)
    scores = cross_val_score(pipeline, signatures(), labels(), cv=folds, error_score="raise")
    assert scores.mean() >= 0.75
    search = GridSearchCV(
        make_pipeline(SignatureFeatures(), StandardScaler(), LogisticRegression()),
        {
            "signaturefeatures__kind": ["axis", "summary"],
            "signaturefeatures__harmonics": [1, 2],
        },
        cv=folds,
        error_score="raise",
    )
    search.fit(signatures(), labels())
    assert search.best_score_ >= 0.75
    assert len(search.predict(signatures()[:2])) == 2
    assert clone(search.best_estimator_[0]).get_params() == search.best_estimator_[0].get_params()
    names = search.best_estimator_[:-1].get_feature_names_out()
    assert len(names) == search.best_estimator_[-1].coef_.shape[1]


def test_covariates_are_columns_on_request() -> None:
    stated: list[dict[str, float | str]] = [{"age": 61, "sex": "f"}, {"sex": "m"}, {"age": 40}]
    some = [
        TrainingCase(one, "any", covariates=covariates)
        for one, covariates in zip(signatures(), stated, strict=False)
    ]
    plain = SignatureFeatures().fit(some)
    for wanted in ("all", ["age", "sex"]):
        features = SignatureFeatures(covariates=wanted)
        table = features.fit_transform(some)
        names = features.get_feature_names_out().tolist()
        n = len(plain.get_feature_names_out())
        assert names[n:] == ["covariate age", "covariate sex=f", "covariate sex=m"]
        nan = float("nan")
        expected = [[61, 1, 0], [nan, 0, 1], [40, nan, nan]]
        assert np.array_equal(table[:, n:], np.array(expected), equal_nan=True)
        assert np.array_equal(table[:, :n], plain.transform(some))
    # A word that was not seen is none of those that were.
    other = TrainingCase(signatures()[0], "any", covariates={"sex": "x", "age": "old"})
    assert np.array_equal(features.transform([other])[0, n:], [nan, 0, 0], equal_nan=True)
    imputed = make_pipeline(features, SimpleImputer()).fit_transform(some)
    assert np.isfinite(imputed).all()
    with pytest.raises(ParameterError, match="'weight'") as caught:
        SignatureFeatures(covariates=["weight"]).fit(some)
    assert caught.value.remedy.endswith("age, sex.")


@pytest.mark.thorough
def test_remarks_are_no_columns_unless_they_are_named() -> None:
    some = [
        TrainingCase(cohort(12)[k].signature, "any", covariates={"name": f"P {k}"})
        for k in range(24)
    ]
    plain = SignatureFeatures().fit(some).get_feature_names_out()
    everything = SignatureFeatures(covariates="all").fit(some).get_feature_names_out()
    assert plain.tolist() == everything.tolist()
    assert len(SignatureFeatures(covariates=["name"]).fit(some).covariate_columns_) == 24


def test_surfaces_that_look_like_several_topologies_are_read_in_one_basis() -> None:
    sequences = [sequence for sequence, _ in bent_cohort(2, 1)]
    assert {modal_signature(one, MEAN).surface for one in sequences} == {"sphere", "mesh"}
    features = SignatureFeatures().fit(sequences)
    assert features.readable_.topologies == ("mesh",)
    assert np.isfinite(features.transform(sequences)).all()
    stated = SignatureFeatures(topology="mesh").fit(sequences)
    assert np.array_equal(stated.transform(sequences), features.transform(sequences))


def test_what_does_not_compare_is_named_by_its_number() -> None:
    fitted = SignatureFeatures().fit(signatures())
    more = modal_signature(beats()[0][1], SignatureParameters(modes=12, reference="mean"))
    bent = next(bent_cohort(1, 1))[0]
    still = mesh_sequence(bent.vertices[:1], bent.faces)
    for odd in (more, bent, modal_signature(still, MEAN)):
        with pytest.raises(InputError, match="Item 1 ") as caught:
            fitted.transform([signatures()[0], odd])
        assert caught.value.remedy
    with pytest.raises(UnlikeCasesError, match="Item 2 "):
        SignatureFeatures().fit([*signatures()[:2], more])


@pytest.mark.parametrize(
    ("options", "X", "said"),
    [
        ({"kind": "best"}, "signatures", "'kind' is 'best'"),
        ({"modes": 0}, "signatures", "'modes' is 0"),
        ({"timing": "waltz"}, "signatures", "'timing' is 'waltz'"),
        ({"topology": "ball"}, "signatures", "'ball' names no topology"),
        ({"kind": "axis", "timing": "course"}, "signatures", "these are no cycles"),
        ({"kind": "terms"}, "signatures", "theta may start anywhere"),
        ({}, [], "There is no recording"),
        ({}, [1.0], "Item 0 is a float"),
    ],
)
def test_what_cannot_be_read_is_refused(options: dict[str, Any], X: Any, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        SignatureFeatures(**options).fit(signatures() if X == "signatures" else X)
    assert caught.value.remedy


def test_the_room_is_imported_without_scikit_learn() -> None:
    code = (
        "import sys, modalmotion.classification as c; print('sklearn' in sys.modules);"
        "c.SignatureFeatures, c.MotionClassifier; print('sklearn' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["False", "True"]
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = __import__("modalmotion.classification").classification.nothing
