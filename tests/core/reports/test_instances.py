"""Reports as DICOM objects: valid by others' checks, read back by others, the same bytes."""

from __future__ import annotations

import io
import logging
import shutil
import subprocess
import warnings
import zipfile
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dicom_samples import study_instance
from norm_controls import beat

import modalmotion as mm
from modalmotion.classification import classify
from modalmotion.errors import ParameterError
from modalmotion.formats.parser_child import ParserHere
from modalmotion.formats.text_meshes import read_stl
from modalmotion.limits import DEFAULT_LIMITS
from modalmotion.norm import train_norm
from modalmotion.reports import Report, quantities_of, report_of
from modalmotion.reports.content import moments_of
from modalmotion.reports.dicom import Study, dicom_instances, dicom_zip, read_study
from modalmotion.simulate import MotionClass

pydicom = pytest.importorskip("pydicom")
codes = pytest.importorskip("pydicom.sr.codedict").codes
highdicom = pytest.importorskip("highdicom")

ISSUED = datetime(2026, 1, 31, 12, tzinfo=UTC)
NAMES = ["report.dcm", "end-diastole.dcm", "end-systole.dcm"]
HERE = ParserHere(DEFAULT_LIMITS)


def in_space(sequence: mm.MeshSequence, **facts: Any) -> mm.MeshSequence:
    stated = {"coordinates": "LPS", "cavity": "lv", "modality": "MR", **facts}
    return replace(sequence, unit="mm", facts=replace(sequence.facts, **stated))


def report(sequence: mm.MeshSequence, **parts: Any) -> Report:
    signature = mm.modal_signature(sequence, mm.SignatureParameters(modes=7))
    return report_of(signature, sequence, issued=ISSUED, **parts)


@pytest.fixture(scope="module")
def study() -> Study:
    return read_study(study_instance(), parser=HERE)


@pytest.fixture(scope="module")
def whole() -> Report:
    sequence = in_space(beat(5, MotionClass.HYPOKINESIA))
    deviation = train_norm(map(beat, range(9)), "volunteers").deviation(sequence, level=0.1)
    return report(sequence, classification=classify(sequence), deviation=deviation)


@pytest.fixture(scope="module")
def files(whole: Report, study: Study) -> dict[str, bytes]:
    return dicom_instances(whole, study)


def opened(data: bytes) -> Any:
    return pydicom.dcmread(io.BytesIO(data))


def numbers(sr: Any) -> dict[str, float]:
    """Every number of a structured report by its code, exact."""
    found: dict[str, float] = {}

    def walk(item: Any) -> None:
        if item.get("ValueType") == "NUM":
            name = item.ConceptNameCodeSequence[0]
            code = name.get("CodeValue") or name.get("LongCodeValue")
            value = item.MeasuredValueSequence[0]
            number = float(value.FloatingPointValue)
            assert float(value.NumericValue) == pytest.approx(number, rel=1e-10, abs=1e-13)
            # Probabilities and p-values have one code, and the whole comes first.
            found.setdefault(code, number)
        for child in item.get("ContentSequence", ()):
            walk(child)

    walk(sr)
    return found


def test_objects_are_of_the_patients_study(files: dict[str, bytes]) -> None:
    assert list(files) == NAMES
    for data in files.values():
        one = opened(data)
        assert (one.StudyInstanceUID, one.PatientID) == ("1.2.3.4.5", "P 7")
        assert str(one.PatientName) == "Müller^Jörg"
        assert (one.StudyDate, one.AccessionNumber) == ("20260102", "A 9")
        assert (one.ContentDate, one.ContentTime) == ("20260131", "120000")
        assert one.SeriesInstanceUID != "1.2.4"
    sr = opened(files["report.dcm"])
    assert (sr.PreliminaryFlag, sr.VerificationFlag) == ("PRELIMINARY", "UNVERIFIED")
    (evidence,) = sr.CurrentRequestedProcedureEvidenceSequence
    (series,) = evidence.ReferencedSeriesSequence
    assert series.ReferencedSOPSequence[0].ReferencedSOPInstanceUID == "1.2.3.1"
    uids = {opened(data).SOPInstanceUID for data in files.values()}
    assert len(uids) == len(files)


def test_numbers_are_those_of_the_library(whole: Report, files: dict[str, bytes]) -> None:
    found = numbers(opened(files["report.dcm"]))
    # The term of LOINC that the FHIR bundle has, too.
    found["ejection-fraction"] = found.pop("10230-1")
    for name, keyword in (
        ("gls", "LongitudinalLagrangianStrain"),
        ("gcs", "CircumferentialLagrangianStrain"),
    ):
        found[name] = found.pop(getattr(codes.DCM, keyword).value)
    for one in quantities_of(whole):
        code = one.name.replace("_", "-")
        assert found[code] == one.value
        assert (found[f"{code}-low"], found[f"{code}-high"]) == (one.low, one.high)
    assert found["max-error"] == whole.signature.max_errors.max()
    assert whole.deviation is not None
    assert found["p"] == whole.deviation.p
    parsed = highdicom.sr.srread(io.BytesIO(files["report.dcm"]))
    groups = parsed.content.get_image_measurement_groups()
    assert len(groups) == 4
    names = {group.finding_type.meaning: group for group in groups}
    values = {one.name.value: one.value for one in names["Class of motion"].get_measurements()}
    assert whole.classification is not None
    assert list(values.values())
    (stated,) = names["Class of motion"].get_qualitative_evaluations()
    assert stated.value.meaning == (whole.classification.label or stated.value.meaning)


def test_surfaces_are_those_that_were_sent(whole: Report, files: dict[str, bytes]) -> None:
    for (frame, name), file in zip(moments_of(whole), NAMES[1:], strict=True):
        one = opened(files[file])
        assert one.MIMETypeOfEncapsulatedDocument == "model/stl"
        assert one.FrameOfReferenceUID == "1.2.5"
        assert one.DocumentTitle == f"{name.capitalize()}, frame {frame}"
        surface = read_stl(one.EncapsulatedDocument[: one.EncapsulatedDocumentLength])
        faces, vertices = whole.sequence.faces, whole.sequence.vertices[frame]
        corners = np.sort(vertices[faces].astype(np.float32), axis=1)
        np.testing.assert_array_equal(np.sort(surface.positions.reshape(-1, 3, 3), axis=1), corners)


def test_the_same_report_and_study_are_the_same_bytes(
    whole: Report, study: Study, files: dict[str, bytes]
) -> None:
    zipped = dicom_zip(whole, study)
    assert zipped == dicom_zip(whole, study)
    with zipfile.ZipFile(io.BytesIO(zipped)) as archive:
        assert {name: archive.read(name) for name in archive.namelist()} == files
    other = read_study(study_instance(StudyInstanceUID="1.2.3.4.6"), parser=HERE)
    uids = [opened(own).SOPInstanceUID for own in dicom_instances(whole, other).values()]
    assert not set(uids) & {opened(data).SOPInstanceUID for data in files.values()}


def test_without_a_stated_space_nothing_is_written(study: Study) -> None:
    plain = beat(5)
    for sequence, fact, said in (
        (replace(plain, unit="mm"), "coordinates", "are not stated"),
        (in_space(plain, coordinates="RAS"), "coordinates", "are RAS"),
        (replace(in_space(plain), unit=None), "unit", "is unknown"),
        (replace(in_space(plain), unit="cm"), "unit", "is cm"),
    ):
        with pytest.raises(ParameterError, match=said) as refused:
            dicom_instances(report(sequence), study)
        assert refused.value.details == {"fact": fact}
        assert refused.value.remedy


def test_nobody_hears_of_the_patient(
    whole: Report, study: Study, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        # A name that highdicom would warn of.
        odd = read_study(study_instance(PatientName="Müller"), parser=HERE)
        dicom_instances(whole, odd)
    said = caplog.text + "".join(str(one.message) for one in warned)
    assert "ller" not in said
    assert "P 7" not in said
    assert "ller" not in repr(study)


def test_a_class_that_is_none_and_no_model_are_told_apart(whole: Report, study: Study) -> None:
    assert whole.classification is not None
    abstained = replace(whole.classification, label=None, flags=("unlike_training",))
    for answer, code in ((abstained, "no-class"), (None, "not-asked")):
        one = replace(whole, classification=answer)
        text = str(opened(dicom_instances(one, study)["report.dcm"]))
        assert code in text
    unknown = Study({**study.header, "SOPClassUID": "1.2.840.10008.5.1.4.1.1.999"})
    with pytest.raises(ParameterError, match="not supported"):
        dicom_instances(whole, unknown)


def faults(data: bytes, folder: Path) -> list[str]:
    """Errors that Debian's dicom3tools and dcmtk find in an object."""
    path = folder / "object.dcm"
    path.write_bytes(data)
    checked = subprocess.run(["dciodvfy", path], capture_output=True, text=True, errors="replace")
    said = [line for line in checked.stderr.splitlines() if line.startswith("Error")]
    if opened(data).Modality == "SR":
        dumped = subprocess.run(["dsrdump", path], capture_output=True, text=True, errors="replace")
        assert "Imaging Measurement Report" in dumped.stdout
        said += [line for line in dumped.stderr.splitlines() if line.startswith("E:")]
        if dumped.returncode:
            said.append(f"dsrdump ended with {dumped.returncode}")
    return said


with_checkers = pytest.mark.skipif(
    not (shutil.which("dciodvfy") and shutil.which("dsrdump")),
    reason="dicom3tools and dcmtk are not installed",
)


@with_checkers
def test_others_find_no_error_and_find_those_that_are_made(
    files: dict[str, bytes], tmp_path: Path
) -> None:
    for data in files.values():
        assert faults(data, tmp_path) == []
    spoilt = opened(files["report.dcm"])
    del spoilt.CompletionFlag
    out = io.BytesIO()
    spoilt.save_as(out)
    assert faults(out.getvalue(), tmp_path)


@with_checkers
@pytest.mark.soak
def test_of_fifty_drawn_results_others_find_no_error(study: Study, tmp_path: Path) -> None:
    kinds = list(MotionClass)
    for seed in range(50):
        sequence = in_space(
            beat(seed, kinds[seed % len(kinds)]), cavity=("lv", "rv", "unknown")[seed % 3]
        )
        answer = classify(sequence) if seed % 2 else None
        for data in dicom_instances(report(sequence, classification=answer), study).values():
            assert faults(data, tmp_path) == [], seed
            assert pydicom.dcmread(io.BytesIO(data)).StudyInstanceUID == "1.2.3.4.5"
