"""Content of a report of one recording, gathered once for every form."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

from modalmotion.classification.answer import Classification
from modalmotion.clinical import ClinicalReadouts, clinical_readouts
from modalmotion.clinical.ventricle import VentricleReadouts, ventricle_readouts
from modalmotion.errors import InputError, ParameterError
from modalmotion.hdf5.image import INTENDED_USE
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.norm import Deviation
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature
from modalmotion.template import Template

_OF_COMMANDS: Final = re.compile(r" \(--[^)]*\)|[;,] state [^.;]*--[^.;]*| by --[a-z-]+")


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
    readouts: ClinicalReadouts | None
    ventricle: VentricleReadouts | None
    classification: Classification | None
    deviation: Deviation | None
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
        notes = []
        if self.deviation is not None:
            theirs = f"Recorded differently from the controls of {self.deviation.norm}"
            notes += [f"{theirs}: {words}" for words in self.deviation.warnings]
            notes += self.deviation.notes
        notes += self.signature.notes
        if self.readouts is not None:
            notes += self.readouts.notes
        if self.classification is not None:
            notes += self.classification.notes
        # Readers of a report have no command line.
        plain = [_OF_COMMANDS.sub("", note) for note in (*notes, *self.absent)]
        return tuple(dict.fromkeys(plain))

    @property
    def intended_use(self) -> str:
        """Intended use."""
        return INTENDED_USE

    @property
    def digest(self) -> str:
        """sha256 of what the report is based on, in hex: the recording and each result's origin."""
        signature = self.signature
        parts = [signature.sequence_id, signature.parameters.key, str(signature.provenance)]
        if self.classification is not None:
            parts.append(self.classification.model_id)
        if self.deviation is not None:
            parts += [self.deviation.norm_id, repr(self.deviation.level)]
        parts.append(self.issued.isoformat())
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def report_of(
    signature: ModalSignature,
    sequence: MeshSequence,
    *,
    issued: datetime,
    template: Template | None = None,
    classification: Classification | None = None,
    deviation: Deviation | None = None,
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
        raise ParameterError(
            "The time of the report has no zone.",
            remedy="Give datetime.now(UTC), or a time with its offset such as "
            "2026-01-31T12:00:00+01:00.",
            details={"option": "issued"},
        )
    for name, part in (("classification", classification), ("deviation", deviation)):
        if part is not None and part.sequence_id != signature.sequence_id:
            raise ParameterError(
                f"The {name} is of the sequence {part.sequence_id[:12]}, the signature of "
                f"{signature.sequence_id[:12]}.",
                remedy="Give results of one recording.",
            )
    absent = []
    readouts = ventricle = None
    try:
        readouts = clinical_readouts(signature, sequence, template=template)
        ventricle = ventricle_readouts(signature, sequence, readouts, template=template)
    except InputError as error:
        absent.append(error.message)
    if ventricle is not None:
        absent += ventricle.reasons
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
