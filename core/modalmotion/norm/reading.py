"""What is read of one recording, and in what it was made unlike others."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.cohort import conditions_of
from modalmotion.classification.extractor import Extractor
from modalmotion.classification.motion import Motion
from modalmotion.clinical import Fraction, clinical_readouts
from modalmotion.errors import ParameterError, TopologyError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature
from modalmotion.signature.value import first_modes

QUANTITIES: Final = ("share", "end_diastolic_volume", "end_systolic_volume")
"""Share of the volume that is lost, percent; volumes, ml, NaN where the unit is unknown."""

Array = NDArray[np.float64]


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


def reading_of(
    signature: ModalSignature,
    sequence: MeshSequence | None,
    extractor: Extractor,
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
    """
    facts = signature.facts
    quantities, fraction = _volumes(signature, sequence)
    conditions = {
        name: value
        for name, value in conditions_of(signature).items()
        if name not in facts.covariates
    }
    return Reading(
        values=extractor.values(Motion(first_modes(signature, extractor.n_modes))),
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


def warnings_of(controls: Sequence[Reading], own: Reading) -> tuple[str, ...]:
    """Compare the conditions and covariates of a recording with those of controls.

    A number is unlike theirs where it lies farther beyond them than they lie apart, so that a
    recording like them is hardly ever warned of.
    """
    warnings = []
    for what in ("conditions", "covariates"):
        mine, theirs = getattr(own, what), [getattr(one, what) for one in controls]
        for name, value in mine.items():
            known = [one[name] for one in theirs if name in one]
            said = _unlike(name, value, known, is_condition=what == "conditions")
            if said:
                warnings.append(said)
    trackings = {one.tracking for one in controls}
    if own.tracking not in trackings:
        warnings.append(
            f"tracking: {own.tracking}; of the controls {', '.join(sorted(trackings))}."
        )
    return tuple(warnings)


def _unlike(
    name: str, value: float | str, known: Sequence[float | str], *, is_condition: bool
) -> str | None:
    if not known:
        return None
    if isinstance(value, str):
        words = sorted({str(one) for one in known})
        if value in words:
            return None
        return f"{_called(name)}: {value}; of the controls {', '.join(words[:5])}."
    numbers = [float(one) for one in known if not isinstance(one, str)]
    if not numbers:
        return None
    low, high = min(numbers), max(numbers)
    # Who is older than all controls is beyond what they can tell.
    margin = (high - low) if is_condition else 0.0
    if low - margin <= value <= high + margin:
        return None
    theirs = f"{low:g}" if low == high else f"{low:g} to {high:g}"
    return f"{_called(name)}: {float(value):g}; of the controls {theirs}."


def _called(name: str) -> str:
    return f"number of {name}" if name in ("frames", "vertices") else name
