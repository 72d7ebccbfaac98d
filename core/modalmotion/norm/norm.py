"""Controls, and the comparison of a recording with them."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.arguments.tasks import Saved
from modalmotion.choice.parameters import parameters_as_json
from modalmotion.classification.answer.classifier import fitted_in
from modalmotion.classification.features import FeatureReader, like_most
from modalmotion.classification.model.kept_members import reader_texts
from modalmotion.classification.model.model import Readable
from modalmotion.classification.tables.recordings import in_basis
from modalmotion.clinical import Fraction
from modalmotion.errors import ParameterError
from modalmotion.facts import UNKNOWN
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.norm.controls import QUANTITIES, Reading, covariate_table, reading_of
from modalmotion.norm.deviation import Deviation, GroupDeviation, QuantityDeviation
from modalmotion.norm.groups import groups_of
from modalmotion.norm.likeness import warnings_of
from modalmotion.norm.ranks import (
    attainable,
    family_p_values,
    fewest_controls,
    p_values,
    strangeness,
    whole,
    without_covariates,
)
from modalmotion.numerals import counted, numeral
from modalmotion.numeric.kinds import real
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature

LEVEL: Final = 0.05
"""Level at which something is called a deviation, unless one is stated."""

# Controls for each column of covariates and for the mean: fewer tell little of what depends.
_PER_COLUMN: Final = 10

Array = NDArray[np.float64]


@shown("name", "n_controls", "readable.topologies", "readable.n_modes", "id")
@dataclass(frozen=True, eq=False)
class Norm(Saved):
    """Controls of one's own, as recordings are compared with them.

    Parameters
    ----------
    name : str
    readable : Readable
        Modes in which the controls compare.
    reader : FeatureReader
    columns : tuple of str
        Names of the features.
    controls : tuple of Reading
    notes : tuple of str
    """

    name: str
    readable: Readable
    reader: FeatureReader
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
            parameters_as_json(self.readable.parameters),
            [self.readable.topologies, self.readable.n_modes, self.readable.connectivity_id],
            reader_texts(self.reader),
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
        signature = (
            in_basis([recording], self.readable)[0]
            if isinstance(recording, ModalSignature)
            else fitted_in(self.readable, recording)
        )
        # Whether its modes are theirs.
        signature = in_basis([signature], self.readable)[0]
        reading = reading_of(signature, sequence, self.reader, subject=subject, name=name)
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
            Share of recordings like the controls that may be called a deviation.

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
        features, _, _ = like_most([one.values for one in bag])
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
            "topologies": list(self.readable.topologies),
            "n_modes": self.readable.n_modes,
            "features": self.reader.description,
            "groups": list(groups_of(self.columns)),
            "covariates": sorted(set.intersection(*stated)) if stated else [],
            "smallest_level": 1.0 / (self.n_controls + 1),
            "has_volumes": bool(np.isfinite([own.quantities[0] for own in self.controls]).all()),
            "notes": list(self.notes),
        }


def require_level(level: float) -> float:
    """Check a level.

    Raises
    ------
    ParameterError
        If it is no number between 0 and 1/2.
    """
    value = real("level", level)
    if not 0.0 < value <= 0.5:
        raise ParameterError(
            f"The level is {numeral(value)}.",
            remedy="Use a share of false alarms between 0 and 0.5, such as 0.05.",
            details={"option": "level"},
        )
    return value


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
