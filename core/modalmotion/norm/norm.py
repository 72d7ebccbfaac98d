"""Controls of one's own, and recordings compared with them."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.arguments.checking import Saved
from modalmotion.classification.answer import fitted_in, unlike
from modalmotion.classification.card import require_model_name
from modalmotion.classification.extractor import Extractor
from modalmotion.classification.model import Readable
from modalmotion.clinical import Fraction
from modalmotion.errors import ParameterError, UnlikeCasesError
from modalmotion.hdf5.form import Form
from modalmotion.hdf5.image import Contents, Dataset, json_text
from modalmotion.mesh import UNKNOWN
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.norm.deviation import (
    LEVEL,
    CohortDeviation,
    Deviation,
    GroupDeviation,
    QuantityDeviation,
    attainable,
    exchange_p,
    family_p_values,
    fewest_controls,
    groups_of,
    p_values,
    require_level,
    standardised,
    strangeness,
    whole,
    without_covariates,
)
from modalmotion.norm.reading import (
    QUANTITIES,
    Reading,
    covariate_table,
    reading_of,
    warnings_of,
)
from modalmotion.representation import counted, numeral, shown
from modalmotion.signature.making import ModalSignature

FORM: Final = Form("norm", 2)

FEWEST_RECORDINGS: Final = 5
"""Fewer are no cohort."""

# Controls for each column of covariates and for the mean: fewer tell little of what depends.
_PER_COLUMN: Final = 10

# Conditions that are numbers: where they differ, another machine or protocol stands behind.
_CONDITIONS: Final = ("frames", "frame rate", "vertices")

# Of each control, in JSON.
_TEXTS: Final = ("conditions", "covariates", "tracking", "sequence_id", "subject")

Array = NDArray[np.float64]


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
    notes : tuple of str
    """

    name: str
    readable: Readable
    extractor: Extractor
    columns: tuple[str, ...]
    controls: tuple[Reading, ...]
    notes: tuple[str, ...] = ()

    @property
    def n_controls(self) -> int:
        """Number of controls."""
        return len(self.controls)

    @cached_property
    def id(self) -> str:
        """sha256 of all that answers depend on, in hex."""
        values = [
            self.readable.as_json(),
            self.extractor.as_json(),
            self.columns,
            [
                [own.conditions, own.covariates, own.tracking, own.sequence_id, own.subject]
                for own in self.controls
            ],
        ]
        digest = hashlib.sha256(json.dumps(values, sort_keys=True).encode())
        for own in self.controls:
            digest.update(own.values.tobytes())
            digest.update(own.quantities.tobytes())
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
        if isinstance(recording, MeshSequence):
            sequence = recording
        signature = recording
        if isinstance(signature, MeshSequence):
            signature = fitted_in(self.readable, signature)
        reason = unlike(signature, self.readable)
        if reason is not None:
            raise UnlikeCasesError(
                f"{name or 'The recording'} does not compare with the controls: {reason.words}.",
                remedy="Give the sequence itself, or its signature with the norm's parameters.",
                details={"sequence_id": signature.sequence_id},
            )
        reading = reading_of(signature, sequence, self.extractor, subject=subject, name=name)
        theirs = {own.tracking for own in self.controls}
        if UNKNOWN not in {*theirs, reading.tracking} and reading.tracking not in theirs:
            raise ParameterError(
                f"The points of this recording follow {reading.tracking}, those of the controls "
                f"{' and '.join(sorted(theirs))}.",
                remedy="Compare it with controls that were made in the same way.",
                details={"tracking": reading.tracking},
            )
        return reading

    def deviation(
        self, recording: MeshSequence | ModalSignature | Reading, *, level: float = LEVEL
    ) -> Deviation:
        """Tell how far a recording lies from the controls.

        Parameters
        ----------
        recording : MeshSequence, ModalSignature or Reading
            A sequence is fitted in the controls' modes; a signature has no volumes. One of the
            controls is compared with the others.
        level : float
            Level: share of recordings like the controls that are called a deviation.

        Returns
        -------
        Deviation
            Exact for any distribution, where the recording comes from where the controls do.

        Raises
        ------
        ParameterError
            If there are too few controls for the level, or it does not compare.
        """
        level = require_level(level)
        own = recording if isinstance(recording, Reading) else self.read(recording)
        controls = [one for one in self.controls if not _same(one, own)]
        self._require_enough(len(controls), level)
        notes = list(self.notes)
        if len(controls) < self.n_controls:
            notes.append("It is one of the controls, and is compared with the others.")
        bag = [*controls, own]
        covariates, remarks = self._covariates(bag)
        table = covariate_table([one.covariates for one in bag], covariates)
        features = np.array([one.values for one in bag])
        adjusted = without_covariates(features, table)
        groups = groups_of(self.columns)
        scores = [strangeness(adjusted[:, k]) for k in groups.values()]
        p = float(p_values(whole(scores))[-1])
        return Deviation(
            norm=self.name,
            norm_id=self.id,
            sequence_id=own.sequence_id,
            n_controls=len(controls),
            level=level,
            attainable=attainable(level, len(controls)),
            p=p,
            deviates=_at_most(p, level),
            groups=_groups(groups, scores, features, level),
            quantities=_quantities(bag, table),
            covariates=tuple(covariates),
            warnings=warnings_of(controls, own),
            notes=(*notes, *remarks),
        )

    def _covariates(self, bag: Sequence[Reading]) -> tuple[list[str], list[str]]:
        """Covariates that are accounted for, and why others are not."""
        *controls, own = bag
        stated = sorted(set.intersection(*(set(one.covariates) for one in controls)))
        names, remarks = [], []
        for name in stated:
            theirs = {one.covariates[name] for one in controls}
            if len({*theirs}) < 2:
                continue
            if name not in own.covariates:
                remarks.append(f"{name} is not stated, so it is not accounted for.")
            elif isinstance(own.covariates[name], str) and own.covariates[name] not in theirs:
                remarks.append(
                    f"No control has {name} = {own.covariates[name]}, so {name} is not accounted "
                    "for."
                )
            elif any(isinstance(one, str) for one in {*theirs, own.covariates[name]}) != all(
                isinstance(one, str) for one in {*theirs, own.covariates[name]}
            ):
                remarks.append(f"{name} is a word here and a number there: not accounted for.")
            else:
                names.append(name)
        most = len(controls) // _PER_COLUMN - 1
        while names and covariate_table([one.covariates for one in bag], names).shape[1] > most:
            left = names.pop()
            remarks.append(
                f"{left} is not accounted for: {counted(len(controls), 'control')} are enough for "
                f"{max(most, 0)} columns of covariates."
            )
        return names, remarks

    def _require_enough(self, n: int, level: float) -> None:
        fewest = fewest_controls(level)
        if n < fewest:
            raise ParameterError(
                f"The norm has {counted(n, 'control')} for this recording; a level of {level:g} "
                f"needs {fewest}.",
                remedy=f"Add {counted(fewest - n, 'control')}, or state a level of at least "
                f"{math.ceil(1000.0 / (n + 1)) / 1000.0:g}.",
                details={"n_controls": n, "needed": fewest},
            )

    def as_json(self) -> dict[str, Any]:
        """Say what it is, as JSON values, without any control's features."""
        stated = [set(own.covariates) for own in self.controls]
        return {
            "name": self.name,
            "id": self.id,
            "n_controls": self.n_controls,
            "topology": self.readable.topology,
            "n_modes": self.readable.n_modes,
            "features": self.extractor.description,
            "groups": list(groups_of(self.columns)),
            "covariates": sorted(set.intersection(*stated)) if stated else [],
            "smallest_level": 1.0 / (self.n_controls + 1),
            "has_volumes": bool(np.isfinite([own.quantities[0] for own in self.controls]).all()),
            "notes": list(self.notes),
        }


def _same(control: Reading, own: Reading) -> bool:
    return control.sequence_id == own.sequence_id or (
        control.subject is not None and control.subject == own.subject
    )


def _at_most(p: float, level: float) -> bool:
    """Whether a p-value is at most the level, to rounding."""
    return p <= level * (1.0 + 1e-9)


def _groups(
    groups: dict[str, list[int]], scores: Sequence[Array], features: Array, level: float
) -> tuple[GroupDeviation, ...]:
    found = []
    corrected = family_p_values(scores)[:, -1]
    for (name, k), score, p in zip(groups.items(), scores, corrected, strict=True):
        amounts = np.linalg.norm(features[:, k], axis=1)
        found.append(
            GroupDeviation(
                name=name,
                p=float(p),
                p_alone=float(p_values(score)[-1]),
                share_less=float((amounts[:-1] < amounts[-1]).mean()),
                deviates=_at_most(float(p), level),
            )
        )
    return tuple(found)


def _quantities(bag: Sequence[Reading], covariates: Array) -> tuple[QuantityDeviation, ...]:
    table = np.array([one.quantities for one in bag])
    fraction = bag[-1].fraction or Fraction.VOLUME_CHANGE
    found = []
    for k, name in enumerate(QUANTITIES):
        values = table[:, k]
        if not np.isfinite(values).all():
            continue
        rest = without_covariates(values[:, None], covariates)[:, 0]
        found.append(
            QuantityDeviation(
                name=str(fraction) if name == "share" else name,
                value=float(values[-1]),
                unit="%" if name == "share" else "ml",
                p=float(p_values(np.abs(rest - rest.mean()))[-1]),
                share_less=float((values[:-1] < values[-1]).mean()),
            )
        )
    return tuple(found)


def cohort_deviation(
    norm: Norm,
    recordings: Iterable[MeshSequence | ModalSignature | Reading],
    *,
    level: float = LEVEL,
) -> CohortDeviation:
    """Compare several recordings with the controls, each and together.

    Together by the energy distance (Szekely and Rizzo, 2004) of features, volumes and conditions
    between recordings and controls, beside those of 1,999 exchanges of the two.

    Parameters
    ----------
    norm : Norm
    recordings : iterable of MeshSequence, ModalSignature or Reading
        At least five that are no controls.
    level : float
        Of each, and of the warning.

    Raises
    ------
    ParameterError
        If there are too few.
    ModalMotionError
        If one does not compare.
    """
    level = require_level(level)
    readings = [one if isinstance(one, Reading) else norm.read(one) for one in recordings]
    others = others_than(norm, readings)
    if len(others) < FEWEST_RECORDINGS:
        raise ParameterError(
            f"Without the controls {counted(len(others), 'recording')} came.",
            remedy=f"Give at least {FEWEST_RECORDINGS} to compare a cohort, or compare each alone.",
            details={"n": len(others), "needed": FEWEST_RECORDINGS},
        )
    deviations = tuple(norm.deviation(one, level=level) for one in readings)
    bag = [*norm.controls, *others]
    features = standardised(np.array([one.values for one in bag]))
    more = np.array([_numbers(one) for one in bag])
    beside = standardised(more[:, np.isfinite(more).all(axis=0)])
    weighed = [features / np.sqrt(max(1, features.shape[1])), beside / 2.0]
    p = exchange_p(np.concatenate(weighed, axis=1), norm.n_controls)
    is_another = p <= level
    warning = None
    if is_another:
        warning = (
            f"These {len(readings)} recordings as a whole are unlike the controls (p = "
            f"{numeral(p, 4)}): another machine, protocol or group of people. Their p-values say "
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


def others_than(norm: Norm, readings: Sequence[Reading]) -> list[Reading]:
    """Leave out readings of the controls themselves."""
    theirs = {one.sequence_id for one in norm.controls}
    return [one for one in readings if one.sequence_id not in theirs]


def _numbers(one: Reading) -> list[float]:
    conditions = [one.conditions.get(name, np.nan) for name in _CONDITIONS]
    numbers = [c if isinstance(c, int | float) else np.nan for c in conditions]
    return [*map(float, numbers), *one.quantities.tolist()]


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
    controls = norm.controls
    datasets = [
        Dataset("values", np.array([c.values for c in controls]), "1", "control, feature"),
        Dataset(
            "quantities", np.array([c.quantities for c in controls]), "%, ml", "control, quantity"
        ),
        json_text("readable", norm.readable.as_json()),
        json_text("extractor", norm.extractor.as_json()),
        json_text("columns", norm.columns),
        json_text("controls", [_texts(one) for one in controls]),
        json_text("notes", norm.notes),
    ]
    return FORM.image({"norm_id": norm.id}, datasets, name=norm.name)


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
        norm = _norm(contents)
        if norm.id != contents.text("norm_id"):
            raise ValueError("its contents are not those that its id names")
    return norm


def _norm(contents: Contents) -> Norm:
    texts = contents.json("controls", list)
    columns = tuple(map(str, contents.json("columns", list)))
    values = contents.array("values", (len(texts), len(columns)))
    quantities = contents.array("quantities", (len(texts), len(QUANTITIES)))
    return Norm(
        name=require_model_name(contents.text("name")),
        readable=Readable.from_json(contents.json("readable", dict)),
        extractor=Extractor.from_json(contents.json("extractor", dict), np.zeros(0)),
        columns=columns,
        controls=tuple(
            _control_of(text, own, numbers)
            for text, own, numbers in zip(texts, values, quantities, strict=True)
        ),
        notes=tuple(map(str, contents.json("notes", list))),
    )


def _texts(one: Reading) -> dict[str, Any]:
    texts = {name: getattr(one, name) for name in _TEXTS}
    return {**texts, "fraction": None if one.fraction is None else str(one.fraction)}


def _control_of(text: Mapping[str, Any], values: Any, quantities: Any) -> Reading:
    fraction = text["fraction"]
    return Reading(
        values=values,
        quantities=quantities,
        fraction=None if fraction is None else Fraction(fraction),
        **{name: text[name] for name in _TEXTS},
    )
