"""The features of a cohort as a table that spreadsheets and scripts read."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from bent_surfaces import bent_beat, bent_cohort
from classify_samples import cohort

from modalmotion.classification import (
    FeatureTable,
    SignatureFeatures,
    TrainingCase,
    feature_table,
)
from modalmotion.errors import MalformedFileError, UnlikeCasesError
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.signature.making import SignatureParameters, modal_signature


@dataclass(frozen=True)
class Broken:
    """A source that cannot be read."""

    name: str = "broken.npz"

    def read(self) -> TrainingCase:
        raise MalformedFileError(f"{self.name}: It ends in the middle.")


def cases() -> list[TrainingCase]:
    return [
        TrainingCase(
            case.motion, case.label, case.subject, f"scans/{k}.npz", {"age": 50 + k} if k else {}
        )
        for k, case in enumerate(cohort(3))
    ]


def test_the_table_is_what_the_transformer_says_beside_the_cases() -> None:
    table = feature_table(cases(), SignatureFeatures(covariates=["age"]))
    features = SignatureFeatures(covariates=["age"]).fit(cases())
    assert np.array_equal(table.values, features.transform(cases()), equal_nan=True)
    assert table.columns == tuple(features.get_feature_names_out())
    assert table.labels == tuple(case.label for case in cases())
    assert table.sequence_ids == tuple(case.sequence_id for case in cases())
    assert "FeatureTable(columns=" in repr(table)


def test_csv_and_json_lose_nothing() -> None:
    table = feature_table(cases(), SignatureFeatures(covariates="all"))
    rows = list(csv.reader(io.StringIO(table.as_csv())))
    assert rows[0] == ["case", "sequence_id", "label", "subject", *table.columns]
    assert [row[0] for row in rows[1:]] == [f"scans/{k}.npz" for k in range(6)]
    values = [[float(cell) if cell else np.nan for cell in row[4:]] for row in rows[1:]]
    assert np.array_equal(values, table.values, equal_nan=True)
    assert rows[1][-1] == ""
    again = FeatureTable.from_json(json.loads(json.dumps(table.as_json())))
    assert np.array_equal(again.values, table.values, equal_nan=True)
    assert again.as_csv() == table.as_csv()


def test_recordings_without_names_and_labels_have_a_table_too() -> None:
    table = feature_table([case.motion for case in cases()])
    assert table.labels == table.subjects == (None,) * 6
    assert table.as_csv().splitlines()[1].startswith(f",{table.sequence_ids[0]},,,")


@pytest.mark.parametrize("place", [0, 2])
def test_what_cannot_be_read_is_left_out_on_request(place: int) -> None:
    some: list[Any] = cases()
    still = mesh_sequence(np.zeros((1, 4, 3)), grid=(2, 2), topology="cup")
    some[place:place] = [Broken(), TrainingCase(still, "", name="still.npz")]
    with pytest.raises(MalformedFileError, match="broken"):
        feature_table(some)
    done: list[int] = []
    table = feature_table(some, on_error="leave out", progress=done.append)
    assert [case.name for case in table.left_out] == ["broken.npz", "still.npz"]
    assert table.left_out[0].reason == "It ends in the middle."
    assert np.array_equal(table.values, feature_table(cases()).values)
    assert done == list(range(1, 9))


@pytest.mark.parametrize("place", [0, 2])
def test_what_does_not_compare_is_named_and_left_out_on_request(place: int) -> None:
    some = cases()
    odd = modal_signature(next(bent_cohort(1, 1))[0], SignatureParameters(reference="mean"))
    some.insert(place, TrainingCase(odd, "x", name="scans/odd.npz"))
    with pytest.raises(UnlikeCasesError, match=r"scans/odd.npz: Item|scans/\d.npz: Item"):
        feature_table(some)
    table = feature_table(some, on_error="leave out")
    assert [case.name for case in table.left_out] == ["scans/odd.npz"]
    assert "do not compare" in table.left_out[0].reason
    assert np.array_equal(table.values, feature_table(cases()).values)


def test_spring_modes_are_taken_where_they_leave_fewer_out() -> None:
    bent = bent_beat("strong", 3.0, np.random.default_rng(5))
    order = np.random.default_rng(6).permutation(bent.n_vertices)
    other = mesh_sequence(bent.vertices[:, order], np.argsort(order)[bent.faces], unit="mm")
    some = [TrainingCase(s, label, name=f"{k}") for k, (s, label) in enumerate(bent_cohort(3, 1))]
    expected = feature_table(some)
    assert expected.left_out == ()
    table = feature_table([TrainingCase(other, "", name="other"), *some], on_error="leave out")
    assert [case.name for case in table.left_out] == ["other"]
    assert np.array_equal(table.values, expected.values)
