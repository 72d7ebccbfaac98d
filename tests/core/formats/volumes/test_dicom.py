"""Headers of instances: copied, checked, and never quoted in an error."""

from __future__ import annotations

import pytest
from dicom_samples import study_instance

from modalmotion.errors import MalformedFileError
from modalmotion.formats.volumes.dicom import parse_study
from modalmotion.limits import DEFAULT_LIMITS

pytest.importorskip("pydicom")


def header(**changes: str | None) -> dict[str, str]:
    info, arrays = parse_study(study_instance(**changes), DEFAULT_LIMITS)
    assert not arrays
    found: dict[str, str] = info["header"]
    return found


def test_patient_and_study_are_read_and_no_pixels() -> None:
    found = header()
    assert found["PatientName"] == "Müller^Jörg"
    assert (found["PatientID"], found["PatientSex"]) == ("P 7", "M")
    assert (found["StudyInstanceUID"], found["FrameOfReferenceUID"]) == ("1.2.3.4.5", "1.2.5")
    assert "PixelData" not in found


def test_moments_that_are_none_are_left_out_as_archives_do() -> None:
    found = header(StudyDate="20261341", StudyTime="late", PatientBirthDate=None)
    assert (found["StudyDate"], found["StudyTime"], found["PatientBirthDate"]) == ("", "", "")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("StudyInstanceUID", None),
        ("StudyInstanceUID", "secret study"),
        ("PatientSex", "SECRET"),
        ("PatientID", "secret" * 40),
        ("AccessionNumber", "secret" * 40),
    ],
)
def test_a_header_that_cannot_be_written_again_is_refused_without_its_value(
    name: str, value: str | None
) -> None:
    with pytest.raises(MalformedFileError, match=name) as refused:
        header(**{name: value})
    assert "secret" not in f"{refused.value.message} {refused.value.remedy}".lower()
    assert refused.value.remedy


@pytest.mark.parametrize("data", [b"", b"no DICOM", study_instance()[:200], b"\0" * 128 + b"DICM"])
def test_other_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(MalformedFileError):
        parse_study(data, DEFAULT_LIMITS)
