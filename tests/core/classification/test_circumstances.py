"""Names of covariates that say how a case was recorded."""

import pytest

from modalmotion.classification.circumstances import is_circumstance
from modalmotion.classification.covariates import features_of
from modalmotion.classification.options import TrainingOptions

RECORDED = (
    *(
        "site",
        "centre",
        "Center",
        "hospital_name",
        "clinic",
        "institution",
        "scanner",
        "ScannerModel",
    ),
    *(
        "vendor",
        "Manufacturer",
        "model",
        "coil",
        "field_strength",
        "FieldStrength",
        "fieldstrength",
        "tesla",
    ),
    *("3T_tesla", "operator", "reader2", "observer", "technician", "batch", "session", "run"),
    *(
        "run_id",
        "protocol",
        "ProtocolName",
        "sequence",
        "sequence_name",
        "software",
        "software-version",
        "fps",
    ),
    *(
        "FPS",
        "frame_rate",
        "frameRate",
        "framerate",
        "frames",
        "n_frames",
        "temporal_resolution",
        "spatialResolution",
    ),
    *("tr", "tr_ms", "TE", "te1", "flip_angle", "slice_thickness_mm", "SliceThickness", "slices"),
    *(
        "voxel_size",
        "kernel",
        "reconstruction",
        "date",
        "scan_date",
        "StudyDate",
        "date_of_scan",
        "year",
    ),
    *(
        "year_of_scan",
        "acquisition_time",
        "export",
        "study_id",
        "siteid",
        "MRScanner",
        "fold",
        "group",
    ),
    *(
        "frame rate",
        "year of scan",
        "Field Strength (T)",
        "number of frames",
        "imaging year",
        "scanned_on",
    ),
)

OWN = (
    *("age", "sex", "weight", "height", "bsa", "bmi", "heart_rate", "heartRate"),
    *(
        "rate",
        "blood_pressure",
        "systolic",
        "birth_year",
        "date_of_birth",
        "birth_date",
        "DateOfBirth",
        "dob",
    ),
    *(
        "age_at_scan",
        "age_at_acquisition",
        "update",
        "last_update",
        "age_group",
        "blood_group",
        "treatment_group",
        "tr_grade",
    ),
    *(
        "infarct_site",
        "image_of_self",
        "years_of_education",
        "centre_of_mass",
        "assist_device",
        "modelled",
        "running",
        "trauma",
    ),
    *("dosage", "candidate", "st_resolution", "heart rate", ""),
)


@pytest.mark.parametrize("name", RECORDED)
def test_how_a_case_was_recorded(name: str) -> None:
    assert is_circumstance(name)


@pytest.mark.parametrize("name", OWN)
def test_what_is_a_patients_own(name: str) -> None:
    assert not is_circumstance(name)


def test_they_are_no_features() -> None:
    cases: list[dict[str, float | str]] = [
        {"age": 61.0, "frame_rate": 25.0, "ScanDate": "2020"},
        {"age": 70.0, "fps": 30.0},
    ]
    assert [dict(case) for case in features_of(cases, TrainingOptions())] == [
        {"age": 61.0},
        {"age": 70.0},
    ]
