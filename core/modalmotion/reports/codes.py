"""Codes of reports: one table, for review.

LOINC is used only if the sender states cavity and modality, because its terms name both; all else
has a code of our own.
"""

from __future__ import annotations

from typing import Any, Final

from modalmotion.facts import Facts

SYSTEM: Final = "urn:modalmotion:codes"
"""Of our own codes."""

LOINC: Final = "http://loinc.org"
UCUM: Final = "http://unitsofmeasure.org"
ABSENT: Final = "http://terminology.hl7.org/CodeSystem/data-absent-reason"
CATEGORY: Final = "http://terminology.hl7.org/CodeSystem/observation-category"

OWN: Final = {
    "analysis": "Motion analysis of a surface",
    "volumes": "Volumes of a moving cavity",
    "ejection_fraction": "Ejection fraction",
    "volume_change": "Volume change",
    "end_diastolic_volume": "End-diastolic volume",
    "end_systolic_volume": "End-systolic volume",
    "stroke_volume": "Stroke volume",
    "gls": "Global longitudinal strain",
    "gcs": "Global circumferential strain",
    "gas": "Global area strain",
    "sdi": "Systolic dyssynchrony index",
    "low": "Lower end of the interval",
    "high": "Upper end of the interval",
    "amplitudes": "Modal amplitudes over time",
    "times": "Times of the frames",
    "volume_curve": "Volume over time",
    "fit": "Error of the modal fit",
    "rms_error": "Root mean square error",
    "max_error": "Largest error",
    "class": "Class of motion",
    "probability": "Probability of a class",
    "deviation": "Deviation from controls",
    "p": "p-value",
}
"""Displays of our own codes."""

WITH_ENDS: Final = (
    *("ejection_fraction", "volume_change", "end_diastolic_volume", "end_systolic_volume"),
    *("stroke_volume", "gls", "gcs", "gas", "sdi"),
)
"""Codes whose numbers have an interval; its ends have codes too."""

# (code, cavities, modalities) -> LOINC code and its exact display.
_LOINC: Final = {
    ("ejection_fraction", "lv"): ("10230-1", "Left ventricular Ejection fraction"),
}

DICOM: Final = {
    "gls": ("130670", "Longitudinal Lagrangian Strain"),
    "gcs": ("130677", "Circumferential Lagrangian Strain"),
}
"""Terms of DICOM (PS3.16, Annex D), without cavity or modality; there is none for the area."""


def own_coding(code: str) -> dict[str, str]:
    """Return the Coding of one of our own codes."""
    return {"system": SYSTEM, "code": code.replace("_", "-"), "display": OWN[code]}


def end_coding(code: str, end: str) -> dict[str, str]:
    """Return the Coding of the lower ("low") or upper ("high") end of a number's interval."""
    text = f"{OWN[code]}: {OWN[end].lower()}"
    return {"system": SYSTEM, "code": f"{code}-{end}".replace("_", "-"), "display": text}


def code_systems() -> list[dict[str, Any]]:
    """Return the codes of all reports as FHIR resources, for validators.

    Returns
    -------
    list of dict
        CodeSystems, ready for JSON: our own, complete, and the LOINC terms that are used.
    """
    own = [own_coding(code) for code in OWN]
    own += [end_coding(code, end) for code in WITH_ENDS for end in ("low", "high")]
    loinc = [{"code": code, "display": display} for code, display in _LOINC.values()]
    return [
        {
            "resourceType": "CodeSystem",
            "url": url,
            "status": "active",
            "content": content,
            "concept": [{"code": one["code"], "display": one["display"]} for one in codings],
        }
        for url, content, codings in ((SYSTEM, "complete", own), (LOINC, "fragment", loinc))
    ]


def concept(code: str, facts: Facts | None = None, text: str | None = None) -> dict[str, Any]:
    """Return the CodeableConcept of a code.

    Parameters
    ----------
    code : str
        Of `OWN`.
    facts : Facts, optional
        With a cavity and a modality a term of LOINC is named first.
    text : str, optional
        Instead of the code's display.
    """
    coding = [own_coding(code)]
    if facts is not None and facts.modality not in (None, "simulated"):
        term = _LOINC.get((code, str(facts.cavity)))
        if term is not None:
            coding.insert(0, {"system": LOINC, "code": term[0], "display": term[1]})
    return {"coding": coding, "text": text or OWN[code]}
