"""Content of a report: quantities, their codes and moments of time.

LOINC stands only where the sender states cavity and modality, since its terms name both; all
else has a code of our own.
"""

import hashlib
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final, NamedTuple

import numpy as np

from modalmotion import clinical, errors, mesh, norm
from modalmotion.classification.answer import Classification
from modalmotion.clinical.strain import DEFINITIONS
from modalmotion.clinical.ventricle import VentricleReadouts, ventricle_readouts
from modalmotion.hdf5.image import INTENDED_USE
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature
from modalmotion.template import Template

_OF_COMMANDS: Final = re.compile(
    r" \((--|theta_zero)[^)]*\)|[;,] state [^.;]*--[^.;]*| by --[a-z-]+"
)
_OF_FACTS: Final = re.compile(r"(the fact )?tracking=material")


@shown("sequence_id", "readouts", "classification", "deviation")
@dataclass(frozen=True, eq=False)
class Report:
    """A signature with everything computed from it.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence
    readouts : ClinicalReadouts or None
        None if the surface encloses no volume.
    ventricle : VentricleReadouts or None
    classification : Classification or None
    deviation : Deviation or None
        From one's own controls.
    issued : datetime
        Time of the result, with its zone.
    absent : tuple of str
        Why something is missing.
    name : str
        Of the recording or its subject, for the page only: no other form contains names.
    """

    signature: ModalSignature
    sequence: MeshSequence
    readouts: clinical.ClinicalReadouts | None
    ventricle: VentricleReadouts | None
    classification: Classification | None
    deviation: norm.Deviation | None
    issued: datetime
    absent: tuple[str, ...]
    name: str = ""

    @property
    def sequence_id(self) -> str:
        """Id of the recording."""
        return self.signature.sequence_id

    @property
    def caveats(self) -> tuple[str, ...]:
        """Caveats for the reader, each once."""
        notes: list[str] = []
        if self.deviation is not None:
            theirs = f"Recorded differently from the controls of {self.deviation.norm}"
            notes += [f"{theirs}: {words}" for words in self.deviation.warnings]
        for result in (self.deviation, self.signature, self.readouts, self.classification):
            notes += () if result is None else map(str, result.notes)
        # Readers of a report have no command line.
        plain = [_OF_FACTS.sub("so", _OF_COMMANDS.sub("", n)) for n in (*notes, *self.absent)]
        return tuple(dict.fromkeys(plain))

    @property
    def intended_use(self) -> str:
        """Intended use."""
        return INTENDED_USE

    @property
    def versions(self) -> str:
        """Programs that made it, with their versions."""
        made_by = self.signature.provenance.items()
        return ", ".join(f"{name} {value}" for name, value in made_by)

    @property
    def digest(self) -> str:
        """sha256 of what the report is based on, in hex: the recording and each result's origin."""
        signature, answer, deviation = self.signature, self.classification, self.deviation
        parts = [signature.sequence_id, signature.parameters.key, str(signature.provenance)]
        parts += [] if answer is None else [answer.model_id]
        parts += [] if deviation is None else [deviation.norm_id, repr(deviation.level)]
        text = "\n".join([*parts, self.issued.isoformat()])
        return hashlib.sha256(text.encode()).hexdigest()


def report_of(
    signature: ModalSignature,
    sequence: MeshSequence,
    *,
    issued: datetime,
    template: Template | None = None,
    classification: Classification | None = None,
    deviation: norm.Deviation | None = None,
) -> Report:
    """Gather the content of a report.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence
        The one it was made from.
    issued : datetime
        Time of the result: the same result at the same time is the same report, byte for byte.
    template : Template, optional
        The one that the signature's parameters name, if they name one.
    classification : Classification, optional
    deviation : Deviation, optional

    Raises
    ------
    ParameterError
        If the time has no zone, or a part is of another recording.
    """
    if issued.tzinfo is None:
        raise errors.ParameterError(
            "The time of the report has no zone.",
            remedy="Give datetime.now(UTC), or a time with its offset such as "
            "2026-01-31T12:00:00+01:00.",
            details={"option": "issued"},
        )
    for name, part in (("classification", classification), ("deviation", deviation)):
        if part is not None and part.sequence_id != signature.sequence_id:
            raise errors.ParameterError(
                f"The {name} is of the sequence {part.sequence_id[:12]}, the signature of "
                f"{signature.sequence_id[:12]}.",
                remedy="Give results of one recording.",
            )
    absent = []
    readouts = ventricle = None
    try:
        readouts = clinical.clinical_readouts(signature, sequence, template=template)
        ventricle = ventricle_readouts(signature, sequence, readouts, template=template)
    except errors.InputError as error:
        absent.append(error.message)
    if ventricle is not None:
        absent += map(str, ventricle.reasons)
    return Report(
        signature=signature,
        sequence=sequence,
        readouts=readouts,
        ventricle=ventricle,
        classification=classification,
        deviation=deviation,
        issued=issued.astimezone(UTC).replace(microsecond=0),
        absent=tuple(absent),
    )


@shown()
@dataclass(frozen=True)
class Quantity:
    """A number with the interval of the true one.

    Parameters
    ----------
    name : str
        Code of `codes.OWN`.
    value, low, high : float
    unit : str
        As people read it.
    ucum : str
        Its code in UCUM.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str
    ucum: str


def quantities_of(report: Report) -> tuple[Quantity, ...]:
    """Return volumes, ejection fraction, strain and dyssynchrony, if there are any."""
    readouts = report.readouts
    if readouts is None:
        return ()
    curve, factor = readouts.stated, readouts.shown_in
    unit, ucum = ("ml", "mL") if readouts.unit is not None else ("cubed length units", "1")
    found = [
        Quantity(name, *figure, *(("%", "%") if name == curve.fraction else (unit, ucum)))
        for name, figure in curve.figures(factor).items()
    ]
    strain = None if report.ventricle is None else report.ventricle.strain
    if strain is not None:
        found += [
            Quantity(f"{name.lower()}", *strain.end_systolic[name], "%", "%")
            for name in DEFINITIONS
        ]
        if (index := strain.dyssynchrony) is not None:
            found.append(Quantity("sdi", *index, "% of the cycle", "%"))
    return tuple(found)


class Number(NamedTuple):
    """A number of a report: its code in `OWN`, its text if that is another, value and unit."""

    code: str
    text: str | None
    value: float
    unit: str
    ucum: str


def numbers_of(report: Report) -> dict[str, list[Number]]:
    """Return the numbers of each group that there are: volumes, fit, class, deviation.

    A quantity is followed by the ends of its interval; that of all groups together is the first of
    the deviation.
    """
    signature, answer, deviation = report.signature, report.classification, report.deviation
    unit, ucum = length_unit(signature.unit)
    rms = float(np.sqrt(np.mean(signature.rms_errors**2)))
    groups = {
        "volumes": [
            Number(f"{one.name}{end}", None, value, one.unit, one.ucum)
            for one in quantities_of(report)
            for end, value in (("", one.value), ("_low", one.low), ("_high", one.high))
        ],
        "fit": [
            Number("rms_error", None, rms, unit, ucum),
            Number("max_error", None, float(signature.max_errors.max()), unit, ucum),
        ],
    }
    if answer is not None:
        groups["class"] = [
            Number("probability", f"Probability of {name}", float(p), "1", "1")
            for name, p in zip(answer.classes, answer.probabilities, strict=True)
        ]
    if deviation is not None:
        groups["deviation"] = [
            Number("p", None, deviation.p, "1", "1"),
            *(
                Number("p", f"p-value of {one.name}, corrected", one.p, "1", "1")
                for one in deviation.groups
            ),
        ]
    return groups


def length_unit(unit: str | None) -> tuple[str, str]:
    """Name a unit of length, in words and as UCUM."""
    return ("length units", "1") if unit is None else (unit, unit)


SYSTEM: Final = "urn:modalmotion:codes"
"""Of our own codes."""

LOINC: Final = "http://loinc.org"
UCUM: Final = "http://unitsofmeasure.org"
ABSENT: Final = "http://terminology.hl7.org/CodeSystem/data-absent-reason"
CATEGORY: Final = "http://terminology.hl7.org/CodeSystem/observation-category"

_PLAIN: Final = {
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

OWN: Final = _PLAIN | {
    f"{code}_{end}": f"{_PLAIN[code]}: {_PLAIN[end].lower()}"
    for code in (
        *("ejection_fraction", "volume_change", "end_diastolic_volume", "end_systolic_volume"),
        *("stroke_volume", "gls", "gcs", "gas", "sdi"),
    )
    for end in ("low", "high")
}
"""Displays of our own codes, those of the ends of intervals included."""

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


def code_systems() -> list[dict[str, Any]]:
    """Return the codes of all reports as FHIR resources, for validators.

    Returns
    -------
    list of dict
        CodeSystems, ready for JSON: our own, complete, and the LOINC terms that are used.
    """
    own = [own_coding(code) for code in OWN]
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


def concept(code: str, facts: mesh.Facts | None = None, text: str | None = None) -> dict[str, Any]:
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


def moments_of(report: Report) -> list[tuple[int, str]]:
    """Return two frames with their names: the ends of diastole and systole, if there are any."""
    if report.readouts is None:
        middle = int(np.argmax(report.signature.motion_rms))
        return [(0, "first frame"), (middle, "largest motion")]
    curve = report.readouts.mesh_curve
    names = ("end diastole", "end systole")
    if report.readouts.stated.fraction != "ejection_fraction":
        names = ("largest volume", "smallest volume")
    return list(zip((curve.end_diastole, curve.end_systole), names, strict=True))
