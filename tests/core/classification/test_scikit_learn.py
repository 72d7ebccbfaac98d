"""Features and estimator in pipelines of scikit-learn, and tables of features."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from classify_samples import cohort, curve, curves
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.model_selection import cross_val_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from modalmotion.classification import (
    FeatureTable,
    SignatureFeatures,
    TrainingCase,
    feature_table,
)
from modalmotion.errors import ParameterError, UnlikeCasesError


def test_a_pipeline_tells_curves_apart() -> None:
    cases = curves(12)
    labels = [case.label for case in cases]
    shrunk = LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto")
    pipeline = make_pipeline(SignatureFeatures(), StandardScaler(), shrunk)
    assert cross_val_score(pipeline, cases, labels, cv=3).mean() >= 0.9
    shares = pipeline.fit(cases, labels).predict_proba(cases)
    assert shares.sum(axis=1) == pytest.approx(np.ones(24))


@pytest.mark.parametrize("kind", ["auto", "axis", "summary", "modes"])
def test_each_kind_of_features_has_a_name_a_column(kind: str) -> None:
    features = SignatureFeatures(kind=kind)
    values = features.fit_transform(cohort(4))
    assert values.shape == (8, len(features.get_feature_names_out()))
    assert features.transform(cohort(4)[:2]) == pytest.approx(values[:2])


def test_terms_of_a_transient_have_a_name_a_column() -> None:
    features = SignatureFeatures(kind="terms", timing="transient")
    names = features.fit(curves(2)).get_feature_names_out().tolist()
    assert features.transform(curves(2)).shape == (4, len(names))
    assert "term 8 (0, cos) x" in names


def test_features_that_recordings_have_not_are_refused() -> None:
    with pytest.raises(ParameterError, match="axis"):
        SignatureFeatures(kind="axis").fit(curves(3))
    with pytest.raises(ParameterError, match="theta is known"):
        SignatureFeatures(kind="terms").fit(cohort(4))
    with pytest.raises(ParameterError, match="'kind'"):
        SignatureFeatures(kind="pieces").fit(curves(3))
    with pytest.raises(UnlikeCasesError, match="case 0"):
        SignatureFeatures().fit(cohort(4)).transform(curves(1))
    with pytest.raises(ParameterError, match="Case 1 is a str"):
        SignatureFeatures().fit([curves(1)[0], "beat"])


def test_covariates_are_columns_on_request() -> None:
    cases = [
        replace(case, covariates={"age": 50 + k, "sex": "fm"[k % 2]} if k else {})
        for k, case in enumerate(curves(3))
    ]
    features = SignatureFeatures(covariates="all")
    values = features.fit_transform(cases)
    names = features.get_feature_names_out().tolist()
    assert names[-3:] == ["covariate age", "covariate sex=f", "covariate sex=m"]
    assert np.isnan(values[0, -3:]).all()
    assert values[1, -3:].tolist() == [51.0, 0.0, 1.0]
    with pytest.raises(ParameterError, match="No case has the covariate"):
        SignatureFeatures(covariates=["weight"]).fit(cases)


def test_a_table_is_the_same_as_csv_and_json_say() -> None:
    table = feature_table(curves(3))
    assert FeatureTable.from_json(table.as_json()).values.tolist() == table.values.tolist()
    lines = table.as_csv().splitlines()
    assert lines[0].startswith("case,sequence_id,label,subject,")
    assert len(lines) == 7
    assert float(lines[1].split(",")[-1]) == table.values[0, -1]


def test_what_does_not_compare_is_left_out_on_request() -> None:
    odd = TrainingCase(cohort(4)[0].signature, "odd", name="odd.npz")
    with pytest.raises(UnlikeCasesError):
        feature_table([*curves(2), odd])
    table = feature_table([*curves(2), odd], on_error="leave out")
    assert len(table.values) == 4
    assert [case.name for case in table.left_out] == ["odd.npz"]
    still = TrainingCase(curve("tip", np.random.default_rng(0), 1), "tip", name="still.npz")
    with pytest.raises(ParameterError, match="one frame"):
        feature_table([*curves(2), still])
