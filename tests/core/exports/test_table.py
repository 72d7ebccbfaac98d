"""Results as tables."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from viewed_surfaces import viewed

from modalmotion.clinical import clinical_readouts
from modalmotion.clinical.ventricle import ventricle_readouts
from modalmotion.exports.tables import (
    Recording,
    Table,
    amplitude_table,
    cohort_table,
    frame_table,
)
from modalmotion.mesh import Facts


@pytest.mark.parametrize(
    ("name", "directions"),
    [
        ("cup", ("x", "y", "z")),
        ("local", ("radial", "tangential", "axial")),
        ("normal displacement", ("normal",)),
    ],
)
def test_every_amplitude_has_a_row(name: str, directions: tuple[str, ...]) -> None:
    _, signature = viewed(name)
    rows = list(csv.DictReader(io.StringIO(amplitude_table(signature).to_csv())))
    assert len(rows) == signature.amplitudes.size
    for row in rows:
        frame, mode = int(row["frame"]), int(row["mode"])
        direction = directions.index(row["direction"])
        assert float(row["amplitude"]) == signature.amplitudes[frame, mode, direction]
        assert row["label"] == str(signature.modes.labels[mode])
        assert float(row["time_s"]) == signature.times[frame]  # type: ignore[index]
    assert {row["unit"] for row in rows} == {"mm"}


def test_deviations_stand_beside_their_amplitudes() -> None:
    signature = viewed("normal displacement")[1]
    assert signature.amplitude_deviations is None
    assert np.isnan(amplitude_table(signature).columns["deviation"]).all()
    sds = 0.1 + np.abs(signature.amplitudes)
    table = amplitude_table(replace(signature, amplitude_deviations=sds))
    np.testing.assert_array_equal(table.columns["deviation"], sds.ravel())


def test_frames_have_errors_volumes_and_segments() -> None:
    sequence, signature = viewed("cup")
    readouts = clinical_readouts(signature, sequence)
    stated = sequence.with_facts(Facts(tracking="material"))
    ventricle = ventricle_readouts(signature, stated, readouts)
    assert ventricle.regions is not None
    assert ventricle.strain is not None
    table = frame_table(signature, readouts, ventricle)
    assert table.n_rows == signature.n_frames
    np.testing.assert_array_equal(table.columns["rms_error"], signature.rms_errors)
    np.testing.assert_allclose(table.columns["volume_ml"], readouts.curve.volumes / 1000.0)
    np.testing.assert_array_equal(
        table.columns["inward_basal_percent"], ventricle.regions.shares[:, 0]
    )
    np.testing.assert_array_equal(table.columns["gls_percent"], ventricle.strain.curves[:, 0])
    np.testing.assert_array_equal(
        table.columns["gcs_basal_deviation"], ventricle.strain.deviations[:, 5]
    )


def test_what_is_missing_is_empty_and_texts_are_quoted() -> None:
    table = Table({"a": np.array([1.0, np.nan]), "b": np.array(['x, "y"', "z"])})
    assert table.to_csv() == 'a,b\r\n1.0,"x, ""y"""\r\n,z\r\n'
    assert repr(table) == "Table(names=('a', 'b'), n_rows=2)"


def test_each_recording_of_a_cohort_has_a_row() -> None:
    sequence, signature = viewed("cup")
    _, other = viewed("normal displacement")
    readouts = clinical_readouts(signature, sequence)
    table = cohort_table(
        [Recording("a.npz", signature, readouts, "P 1", "weak"), Recording("b", other)]
    )
    rows = list(csv.DictReader(io.StringIO(table.to_csv())))
    assert [row["recording"] for row in rows] == ["a.npz", "b"]
    one, two = rows
    assert (one["subject"], one["label"], one["sequence_id"]) == ("P 1", "weak", sequence.id)
    assert float(one["rms_error"]) == signature.rms_error
    curve = readouts.curve
    share = float(one["ejection_fraction_percent"])
    assert share == curve.ejection_fraction
    assert float(one["ejection_fraction_low_percent"]) <= share
    assert share <= float(one["ejection_fraction_high_percent"])
    volume = curve.end_diastolic_volume * readouts.millilitres
    assert float(one["end_diastolic_volume_ml"]) == volume
    label = signature.modes.labels[1]
    expected = np.sqrt(np.mean(signature.amplitudes[:, 1, 2] ** 2))
    assert float(one[f"rms {label} z"]) == pytest.approx(expected, rel=1e-15)
    # What a recording has not is empty: volumes that were not read, directions of another kind.
    assert two["ejection_fraction_percent"] == two["subject"] == two[f"rms {label} z"] == ""
    assert two[f"rms {label} normal"] != ""
    assert cohort_table([]).to_csv() == "\r\n"
