"""What a norm keeps of each control, and reads of a recording that is compared with them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.covariates import with_covariates
from modalmotion.classification.features import FeatureReader, right_handed
from modalmotion.classification.training.conditions import conditions_of
from modalmotion.clinical import Fraction, clinical_readouts
from modalmotion.errors import ParameterError, TopologyError
from modalmotion.facts import Named
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature

QUANTITIES: Final = ("share", "end_diastolic_volume", "end_systolic_volume")
"""Share of the volume that is lost, percent; volumes, ml, NaN where the unit is unknown."""


@shown("sequence_id", "subject")
@dataclass(frozen=True, eq=False)
class Reading:
    """What is read of one recording.

    Parameters
    ----------
    values : (readings, features) float64
        Features of the motion, once for each way in which it can be read.
    quantities : (3,) float64
        See `QUANTITIES`; NaN where there is none.
    fraction : Fraction or None
        What the share is called.
    conditions : mapping of str to (float or str)
        How it was recorded: frames, vertices, frame rate, modality.
    covariates : mapping of str to (float or str)
    tracking : str
        What the points follow.
    sequence_id : str
    subject : str or None
    name : str
        What errors call it.
    """

    values: NDArray[np.float64]
    quantities: NDArray[np.float64]
    fraction: Fraction | None
    conditions: Mapping[str, float | str]
    covariates: Mapping[str, float | str]
    tracking: str
    sequence_id: str
    subject: str | None = None
    name: str = ""


@shown("name", "subject")
@dataclass(frozen=True, eq=False)
class Control:
    """A recording of somebody who is taken as usual.

    Parameters
    ----------
    motion : MeshSequence or ModalSignature
        From a signature alone no volume can be read.
    subject : str or None
        Who was recorded: a norm takes one recording of each.
    name : str
        What errors call it, such as the path of its file.
    covariates : mapping of str to (float or str)
        Over those of the recording's facts.
    sequence : function, optional
        Reads the recording that a signature was made from, for its volumes; None where its
        vertices are not kept.
    """

    motion: MeshSequence | ModalSignature
    subject: str | None = None
    name: str = ""
    covariates: Mapping[str, float | str] = field(default_factory=Named)
    sequence: Callable[[], MeshSequence | None] | None = None

    def __post_init__(self) -> None:
        if self.covariates:
            object.__setattr__(self, "motion", with_covariates(self.motion, self.covariates))

    def read_sequence(self) -> MeshSequence | None:
        """Give the recording itself, where it is known."""
        if isinstance(self.motion, MeshSequence):
            return self.motion
        return None if self.sequence is None else self.sequence()


def reading_of(
    signature: ModalSignature,
    sequence: MeshSequence | None,
    reader: FeatureReader,
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
    reader : FeatureReader
    """
    facts = signature.facts
    features = reader.read(signature)
    quantities, fraction = _volumes(signature, sequence)
    conditions = {
        name: value
        for name, value in conditions_of(signature).items()
        if name not in facts.covariates
    }
    return Reading(
        values=right_handed(features.values),
        quantities=quantities,
        fraction=fraction,
        conditions=conditions,
        covariates=dict(facts.covariates),
        tracking=str(facts.tracking),
        sequence_id=signature.sequence_id,
        subject=subject,
        name=name,
    )


def covariate_table(
    covariates: Sequence[Mapping[str, float | str]], names: Sequence[str]
) -> NDArray[np.float64]:
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


def _volumes(
    signature: ModalSignature, sequence: MeshSequence | None
) -> tuple[NDArray[np.float64], Fraction | None]:
    nothing = np.full(len(QUANTITIES), math.nan)
    if sequence is None:
        return nothing, None
    try:
        readouts = clinical_readouts(signature, sequence)
    except (TopologyError, ParameterError):
        return nothing, None
    curve = readouts.stated
    if curve.share is None:
        return nothing, None
    in_ml = math.nan if readouts.unit is None else readouts.millilitres
    volumes = [in_ml * curve.end_diastolic_volume, in_ml * curve.end_systolic_volume]
    return np.array([curve.share, *volumes]), curve.fraction
