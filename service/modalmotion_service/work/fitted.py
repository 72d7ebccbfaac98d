"""A signature in a file, with all that is read beside it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from modalmotion.mesh import Facts
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import ModalSignature
from modalmotion.store import SequenceRecord, signature_from_hdf5, template_from_hdf5
from modalmotion.template import Template
from modalmotion_service.work.tasks.files import loaded_sequence


@dataclass(frozen=True)
class Fitted:
    """A signature in a file; a worker reads it and what it was made of.

    Parameters
    ----------
    signature, sequence : Path
    template : Path or None
        That its parameters name.
    track : Path or None
        That made the sequence.
    record : SequenceRecord
    """

    signature: Path
    sequence: Path
    template: Path | None
    track: Path | None
    record: SequenceRecord

    @property
    def files(self) -> tuple[Path, ...]:
        """All files of it."""
        files = (self.sequence, self.signature, self.template, self.track)
        return tuple(file for file in files if file is not None)

    @property
    def facts(self) -> Facts:
        """Facts of the sequence, which kept files lack."""
        return self.record.facts

    @property
    def title(self) -> str:
        """What a person calls the sequence; empty where nobody said."""
        return self.record.name or self.record.subject or ""

    def read_signature(self) -> ModalSignature:
        """Read the signature, with the facts."""
        return replace(signature_from_hdf5(self.signature), facts=self.facts)

    def read_sequence(self) -> MeshSequence:
        """Read the sequence, with the facts and what its track says of its positions."""
        return loaded_sequence(self.sequence, self.track).with_facts(self.facts)

    def read_template(self) -> Template | None:
        """Read the template that is named; None for one of the sequence's own."""
        return None if self.template is None else template_from_hdf5(self.template)
