"""Controls of one's own, and recordings compared with them."""

import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion import errors, mesh
from modalmotion.arguments.checking import Saved
from modalmotion.classification import answer, card, model, motion_features
from modalmotion.classification.cases import TrainingCase, as_case
from modalmotion.classification.cohort import alike, conditions_of
from modalmotion.classification.motion import Motion
from modalmotion.clinical import Fraction, clinical_readouts
from modalmotion.hdf5.image import Dataset, Form, json_text
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.norm.deviations import (
    LEVEL,
    CohortDeviation,
    Deviation,
    GroupDeviation,
    QuantityDeviation,
    as_strange,
    attainable,
    exchange_p,
    fewest_controls,
    groups_of,
    standardised,
    strangeness,
    without_covariates,
)
from modalmotion.notes import Note, notes_as_json, notes_from_json
from modalmotion.progress import Reporter, reported
from modalmotion.representation import Floats, counted, numeral, shown
from modalmotion.signature.making import ModalSignature, SignatureKind, SignatureParameters
from modalmotion.signature.value import first_modes

FORM: Final = Form("norm", 5)

QUANTITIES: Final = ("share", "end_diastolic_volume", "end_systolic_volume")
"""Share of the volume that is lost, percent; volumes, ml, NaN where the unit is unknown."""

FEWEST_RECORDINGS: Final = 5
"""Fewer are no cohort."""

# Controls for each column of covariates and for the mean: fewer tell little of what depends.
_PER_COLUMN: Final = 10

# Conditions that are numbers: where they differ, another machine or protocol stands behind.
_CONDITIONS: Final = ("frames", "frame rate", "vertices")


@shown("sequence_id", "subject")
@dataclass(frozen=True, eq=False)
class Reading:
    """What is read of one recording.

    Parameters
    ----------
    values : (features,) float64
        Features of the motion.
    quantities : (3,) float64
        See `QUANTITIES`; NaN where there is none.
    fraction : Fraction or None
        What the share is called.
    conditions : mapping of str to (float or str)
        How it was recorded: frames, vertices, frame rate, modality, and what its points follow.
    covariates : mapping of str to (float or str)
    sequence_id : str
    subject : str or None
    name : str
        What errors call it.
    """

    values: Floats
    quantities: Floats
    fraction: Fraction | None
    conditions: Mapping[str, float | str]
    covariates: Mapping[str, float | str]
    sequence_id: str
    subject: str | None = None
    name: str = ""


@shown("name", "n_controls", "readable.topology", "readable.n_modes", "id")
@dataclass(frozen=True, eq=False)
class Norm(Saved):
    """Controls of one's own, as recordings are compared with them.

    Parameters
    ----------
    name : str
    readable : Readable
        Modes in which the controls compare.
    extractor : Extractor
    columns : tuple of str
        Names of the features.
    controls : tuple of Reading
    notes : tuple of Note
    """

    name: str
    readable: model.Readable
    extractor: motion_features.Extractor
    columns: tuple[str, ...]
    controls: tuple[Reading, ...]
    notes: tuple[Note, ...] = ()

    @property
    def n_controls(self) -> int:
        """Number of controls."""
        return len(self.controls)

    @cached_property
    def id(self) -> str:
        """sha256 of all that answers depend on, in hex."""
        digest = hashlib.sha256()
        for one in _datasets(self):
            digest.update(one.name.encode() + one.values.tobytes())
        return digest.hexdigest()

    def read(
        self,
        recording: MeshSequence | ModalSignature,
        *,
        subject: str | None = None,
        name: str = "",
        sequence: MeshSequence | None = None,
    ) -> Reading:
        """Read a recording as the controls are read.

        Parameters
        ----------
        recording : MeshSequence or ModalSignature
        subject : str or None
            Who was recorded; a control of the same name is left out of the comparison.
        name : str
            What errors call it.
        sequence : MeshSequence, optional
            The one that a signature was made from, for its volumes.

        Raises
        ------
        ParameterError
            If its points follow something else than those of the controls.
        ModalMotionError
            If it cannot be fitted, or has other modes.
        """
        signature = answer.signature_in(self.readable, recording, name)
        sequence = recording if isinstance(recording, MeshSequence) else sequence
        reading = reading_of(signature, sequence, self.extractor, subject=subject, name=name)
        own = reading.conditions["tracking"]
        theirs = {str(one.conditions["tracking"]) for one in self.controls}
        if mesh.UNKNOWN not in {*theirs, own} and own not in theirs:
            raise errors.ParameterError(
                f"The tracking of this recording is {own}, that of the controls "
                f"{' or '.join(sorted(theirs))}.",
                remedy="Compare it with controls that were made in the same way.",
                details={"tracking": own},
            )
        return reading

    def deviation(
        self, recording: MeshSequence | ModalSignature | Reading, *, level: float = LEVEL
    ) -> Deviation:
        """Compare a recording with the controls.

        Parameters
        ----------
        recording : MeshSequence, ModalSignature or Reading
            A sequence is fitted in the controls' modes; a signature has no volumes. One of the
            controls is compared with the others.
        level : float
            Level: share of recordings like the controls that are reported as deviating.

        Returns
        -------
        Deviation
            Exact for any distribution, where the recording comes from where the controls do.

        Raises
        ------
        ParameterError
            If the level is not between 0 and 1/2, there are too few controls for it, or the
            recording does not compare.
        """
        if not 0.0 < level <= 0.5:
            raise errors.ParameterError(
                f"The level is {numeral(level)}.",
                remedy="Use a share of false alarms between 0 and 0.5, such as 0.05.",
                details={"option": "level"},
            )
        own = recording if isinstance(recording, Reading) else self.read(recording)
        controls = [
            one
            for one in self.controls
            if one.sequence_id != own.sequence_id
            and not (one.subject and one.subject == own.subject)
        ]
        n, fewest = len(controls), fewest_controls(level)
        if n < fewest:
            raise errors.ParameterError(
                f"The norm has {counted(n, 'control')} for this recording; a level of {level:g} "
                f"needs {fewest}.",
                remedy=f"Add {counted(fewest - n, 'control')}, or state a level of at least "
                f"{math.ceil(1000.0 / (n + 1)) / 1000.0:g}.",
                details={"n_controls": n, "needed": fewest},
            )
        bag = [*controls, own]
        names, remarks = _accounted_for(controls, own)
        covariates = covariate_table([one.covariates for one in bag], names)
        features, groups = np.array([one.values for one in bag]), groups_of(self.columns)
        adjusted = without_covariates(features, covariates)
        scores = strangeness(adjusted, list(groups.values()))
        together, greatest = scores.sum(axis=0), scores.max(axis=0)
        p = as_strange(together, together[-1])
        found = []
        for (name, columns), score in zip(groups.items(), scores, strict=True):
            amounts = np.linalg.norm(features[:, columns], axis=1)
            corrected = as_strange(greatest, score[-1])
            found.append(
                GroupDeviation(
                    name=name,
                    p=corrected,
                    p_alone=as_strange(score, score[-1]),
                    share_less=float((amounts[:-1] < amounts[-1]).mean()),
                    deviates=_at_most(corrected, level),
                )
            )
        return Deviation(
            norm=self.name,
            norm_id=self.id,
            sequence_id=own.sequence_id,
            n_controls=n,
            level=level,
            attainable=attainable(level, n),
            p=p,
            deviates=_at_most(p, level),
            groups=tuple(found),
            quantities=_quantities(bag, covariates),
            covariates=tuple(names),
            warnings=_warnings(controls, own),
            notes=(*self.notes, *[Note.of("is_control")] * (n < self.n_controls), *remarks),
        )

    def as_json(self) -> dict[str, Any]:
        """Describe it as JSON values, without any control's features."""
        stated = [set(own.covariates) for own in self.controls]
        return {
            "name": self.name,
            "id": self.id,
            "n_controls": self.n_controls,
            "topology": self.readable.topology,
            "n_modes": self.readable.n_modes,
            "features": self.extractor.description,
            "groups": list(groups_of(self.columns)),
            "covariates": sorted(set.intersection(*stated)),
            "smallest_level": 1.0 / (self.n_controls + 1),
            "has_volumes": bool(np.isfinite([own.quantities[0] for own in self.controls]).all()),
            "notes": notes_as_json(self.notes),
        }


def reading_of(
    signature: ModalSignature,
    sequence: MeshSequence | None,
    extractor: motion_features.Extractor,
    *,
    subject: str | None = None,
    name: str = "",
) -> Reading:
    """Read a recording.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence or None
        The one it was made from, for its volumes.
    extractor : Extractor
    subject : str or None
    name : str
    """
    facts, quantities, fraction = signature.facts, np.full(len(QUANTITIES), math.nan), None
    try:
        readouts = None if sequence is None else clinical_readouts(signature, sequence)
    except (errors.TopologyError, errors.ParameterError):
        readouts = None
    if readouts is not None and readouts.stated.share is not None:
        curve, ml = readouts.stated, math.nan if readouts.unit is None else readouts.millilitres
        volumes = ml * curve.end_diastolic_volume, ml * curve.end_systolic_volume
        quantities, fraction = np.array([curve.share, *volumes]), curve.fraction
    conditions = {k: v for k, v in conditions_of(signature).items() if k not in facts.covariates}
    return Reading(
        values=extractor.values(Motion(first_modes(signature, extractor.n_modes))),
        quantities=quantities,
        fraction=fraction,
        conditions={**conditions, "tracking": str(facts.tracking)},
        covariates=dict(facts.covariates),
        sequence_id=signature.sequence_id,
        subject=subject,
        name=name,
    )


def covariate_table(
    covariates: Sequence[Mapping[str, float | str]], names: Sequence[str]
) -> Floats:
    """Covariates as numbers, a word as columns of its own, (members, columns) float64."""
    columns = []
    for name in names:
        values = [one[name] for one in covariates]
        words = sorted({str(value) for value in values})
        if any(isinstance(value, str) for value in values):
            # The last word is what the others are not.
            columns += [[float(str(value) == word) for value in values] for word in words[:-1]]
        else:
            columns.append([float(value) for value in values])
    return np.array(columns, dtype=np.float64).reshape(-1, len(covariates)).T


def _accounted_for(controls: Sequence[Reading], own: Reading) -> tuple[list[str], list[Note]]:
    """Covariates that all controls state and that are accounted for, and why others are not."""
    bag, names, notes = [one.covariates for one in (*controls, own)], list[str](), list[Note]()
    most = max(len(controls) // _PER_COLUMN - 1, 0)
    for name in sorted(set.intersection(*(set(one) for one in bag[:-1]))):
        theirs, mine = {one[name] for one in bag[:-1]}, bag[-1].get(name)
        words = {isinstance(one, str) for one in {*theirs, mine}}
        if len(theirs) < 2:
            continue
        if mine is None:
            reason = "it is not stated"
        elif len(words) > 1 or (True in words and mine not in theirs):
            reason = f"no control has {name} = {mine}"
        elif covariate_table(bag, [*names, name]).shape[1] > most:
            known = counted(len(controls), "control")
            reason = f"{known} are enough for {most} columns of covariates"
        else:
            names.append(name)
            continue
        notes.append(Note.of("covariate_unused", covariate=name, reason=reason))
    return names, notes


def _quantities(bag: Sequence[Reading], covariates: Floats) -> tuple[QuantityDeviation, ...]:
    found, table = [], np.array([one.quantities for one in bag])
    for name, values in zip(QUANTITIES, table.T, strict=True):
        if not np.isfinite(values).all():
            continue
        rest = without_covariates(values[:, None], covariates)[:, 0]
        apart = np.abs(rest - rest.mean())
        found.append(
            QuantityDeviation(
                name=str(bag[-1].fraction) if name == "share" else name,
                value=float(values[-1]),
                unit="%" if name == "share" else "ml",
                p=as_strange(apart, apart[-1]),
                share_less=float((values[:-1] < values[-1]).mean()),
            )
        )
    return tuple(found)


def _warnings(controls: Sequence[Reading], own: Reading) -> tuple[str, ...]:
    """Compare the conditions and covariates of a recording with those of controls.

    A number is unlike theirs where it lies farther beyond them than they lie apart, so that a
    recording like them is hardly ever warned of; who is older than all controls always is.
    """
    warnings = []
    for what in ("conditions", "covariates"):
        stated = [getattr(one, what) for one in controls]
        for name, value in getattr(own, what).items():
            known = {one[name] for one in stated if name in one}
            numbers = [float(one) for one in known if not isinstance(one, str)]
            if isinstance(value, str) and known and value not in known:
                theirs, mine = ", ".join(sorted(map(str, known))[:5]), value
            elif not isinstance(value, str) and numbers:
                low, high = min(numbers), max(numbers)
                margin = (high - low) if what == "conditions" else 0.0
                if low - margin <= value <= high + margin:
                    continue
                theirs, mine = f"{low:g}" + f" to {high:g}" * (low < high), f"{float(value):g}"
            else:
                continue
            called = f"number of {name}" if name in ("frames", "vertices") else name
            warnings.append(f"{called}: {mine}; of the controls {theirs}.")
    return tuple(warnings)


def _at_most(p: float, level: float) -> bool:
    """Whether a p-value is at most the level, to rounding."""
    return p <= level * (1.0 + 1e-9)


def cohort_deviation(
    norm: Norm,
    recordings: Iterable[MeshSequence | ModalSignature | Reading],
    *,
    level: float = LEVEL,
) -> CohortDeviation:
    """Compare recordings with the controls, each, and five or more together.

    Together by the energy distance (Szekely and Rizzo, 2004) of features, volumes and conditions
    between recordings and controls, beside those of 1,999 exchanges of the two.

    Parameters
    ----------
    norm : Norm
    recordings : iterable of MeshSequence, ModalSignature or Reading
        Those that are controls are not among those that are compared together.
    level : float
        Of each, and of the warning.

    Raises
    ------
    ParameterError
        If there are too few controls for the level.
    ModalMotionError
        If one does not compare.
    """
    readings = [one if isinstance(one, Reading) else norm.read(one) for one in recordings]
    theirs, p, warning = {one.sequence_id for one in norm.controls}, None, None
    others = [one for one in readings if one.sequence_id not in theirs]
    deviations = tuple(norm.deviation(one, level=level) for one in readings)
    if len(others) >= FEWEST_RECORDINGS:
        bag = [*norm.controls, *others]
        features = standardised(np.array([one.values for one in bag]))
        more = np.array(
            [
                [*(one.conditions.get(k, np.nan) for k in _CONDITIONS), *one.quantities]
                for one in bag
            ]
        )
        beside = standardised(more[:, np.isfinite(more).all(axis=0)])
        weighed = [features / np.sqrt(max(1, features.shape[1])), beside / 2.0]
        p = exchange_p(np.concatenate(weighed, axis=1), norm.n_controls)
    is_another = None if p is None else p <= level
    if p is not None and is_another:
        warning = (
            f"These {len(readings)} recordings as a whole are unlike the controls (p = "
            f"{numeral(p, 4)}): another scanner, protocol or group of people. Their p-values say "
            "that, too."
        )
    return CohortDeviation(
        norm=norm.name,
        norm_id=norm.id,
        n_controls=norm.n_controls,
        n_recordings=len(readings),
        level=level,
        p=p,
        is_another=is_another,
        warning=warning,
        deviations=deviations,
    )


# Of each control, in JSON.
_TEXTS: Final = [
    one.name for one in fields(Reading) if one.name not in ("values", "quantities", "name")
]


def _datasets(norm: Norm) -> list[Dataset]:
    controls = norm.controls
    values, quantities = ([getattr(c, k) for c in controls] for k in ("values", "quantities"))
    return [
        Dataset("values", np.array(values), "1", "control, feature"),
        Dataset("quantities", np.array(quantities), "%, ml", "control, quantity"),
        json_text("readable", norm.readable.as_json()),
        json_text("extractor", norm.extractor.as_json()),
        json_text("columns", norm.columns),
        json_text("controls", [{k: getattr(c, k) for k in _TEXTS} for c in controls]),
        json_text("notes", norm.notes),
    ]


def norm_to_hdf5(norm: Norm) -> bytes:
    """Write a norm as a sealed HDF5 file in memory.

    It holds features of the controls and no shape. Names of files are left out.

    Parameters
    ----------
    norm : Norm

    Returns
    -------
    bytes
        The same for the same norm.
    """
    return FORM.image({"norm_id": norm.id}, _datasets(norm), name=norm.name)


def norm_from_hdf5(source: bytes | Path) -> Norm:
    """Read a norm, bit for bit as it was written.

    Parameters
    ----------
    source : bytes or Path

    Raises
    ------
    NotFoundError
        If there is no such file.
    CorruptFileError
        If it is damaged, or is no norm.
    """
    with FORM.read(source) as contents:
        texts = contents.json("controls", list)
        columns = tuple(map(str, contents.json("columns", list)))
        values = contents.array("values", (len(texts), len(columns)))
        quantities = contents.array("quantities", (len(texts), len(QUANTITIES)))
        norm = Norm(
            name=card.require_model_name(contents.text("name")),
            readable=model.Readable.from_json(contents.json("readable", dict)),
            extractor=motion_features.Extractor.from_json(contents.json("extractor", dict)),
            columns=columns,
            controls=tuple(
                Reading(
                    values=own,
                    quantities=numbers,
                    **{**text, "fraction": text["fraction"] and Fraction(text["fraction"])},
                )
                for text, own, numbers in zip(texts, values, quantities, strict=True)
            ),
            notes=notes_from_json(contents.json("notes", list)),
        )
        if norm.id != contents.text("norm_id"):
            raise ValueError("its contents are not those that its id names")
    return norm


FEWEST_CONTROLS: Final = 9
"""With fewer no p-value is as small as 1/10."""


def train_norm(
    controls: Iterable[Any],
    name: str,
    *,
    modes: int = 7,
    topology: str | None = None,
    progress: Reporter | None = None,
) -> Norm:
    """Make a norm of recordings of people who are taken as usual.

    The modes in which they compare, and whether they are cycles, are decided from all of them
    together. Nothing else is fitted: what is usual is decided anew for each recording that is
    compared, from the controls and that recording.

    Parameters
    ----------
    controls : iterable of TrainingCase, CaseSource, MeshSequence or ModalSignature
        One recording of each person; labels are not read. Volumes are read of sequences, and of
        signatures whose case names its sequence. Those with points that slide
        (`tracking="normal_displacement"`) are read by their normal displacements.
    name : str
        As models are named.
    modes : int
        Of the signatures of sequences.
    topology : str, optional
        Of these signatures; "mesh" for spring modes.
    progress : function, optional
        Called with the number of controls read and of all.

    Raises
    ------
    ParameterError
        If there are too few controls, two of one person, or the name cannot be kept.
    UnlikeCasesError
        If their modes do not compare.
    ModalMotionError
        If one cannot be fitted; it is named.
    """
    # Here, for scikit-learn takes a second, and whoever reads a norm needs none of it.
    from modalmotion.classification.scikit_learn import SignatureFeatures

    card.require_model_name(name)
    cases = [as_case(one, number) for number, one in enumerate(controls)]
    _require_people(cases)
    transformer = SignatureFeatures(modes=modes, topology=topology)
    parameters = parameters_of_controls(
        transformer.signature_parameters, (case.motion.facts for case in cases)
    )
    signatures = alike(cases, parameters)[0].signatures
    transformer.fit(signatures)
    readings = []
    for case, signature in reported(zip(cases, signatures, strict=True), progress, len(cases)):
        sequence, extractor = case.read_sequence(), transformer.extractor_
        readings.append(
            reading_of(signature, sequence, extractor, subject=case.subject, name=case.name)
        )
    notes = []
    if len(cases) < fewest_controls(LEVEL):
        notes.append(
            Note.of(
                "few_controls",
                controls=counted(len(cases), "control"),
                n_readings=len(cases) + 1,
                level=LEVEL,
                needed=fewest_controls(LEVEL),
            )
        )
    return Norm(
        name=name,
        readable=transformer.readable_,
        extractor=transformer.extractor_,
        columns=tuple(map(str, transformer.get_feature_names_out())),
        controls=tuple(readings),
        notes=tuple(notes),
    )


def parameters_of_controls(
    parameters: SignatureParameters, facts: Iterable[mesh.Facts]
) -> SignatureParameters:
    """Choose the kind that controls are read with: normal displacements if points of one slide."""
    if any(one.tracking == SignatureKind.NORMAL_DISPLACEMENT.value for one in facts):
        return replace(parameters, kind=SignatureKind.NORMAL_DISPLACEMENT)
    return parameters


def _require_people(cases: list[TrainingCase]) -> None:
    if len(cases) < FEWEST_CONTROLS:
        raise errors.ParameterError(
            f"A norm of {counted(len(cases), 'control')} is too small.",
            remedy=f"Give at least {FEWEST_CONTROLS}, and {fewest_controls(LEVEL)} for the usual "
            f"level of {LEVEL}.",
            details={"n_controls": len(cases), "needed": FEWEST_CONTROLS},
        )
    seen: dict[str, str] = {}
    for case in cases:
        for key in filter(None, (case.sequence_id, case.subject and f"subject {case.subject}")):
            if key in seen:
                raise errors.ParameterError(
                    f"{case.name} and {seen[key]} are recordings of one person.",
                    remedy="Give one recording of each control: two of one are too much alike.",
                    details={"case": case.name},
                )
            seen[key] = case.name
