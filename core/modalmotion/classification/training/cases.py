"""Labelled signatures that models are trained and tested on."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from pathlib import Path

from modalmotion.errors import ModalMotionError
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature


@shown("label", "subject", "signature.sequence_id")
@dataclass(frozen=True, eq=False)
class TrainingCase:
    """One signature with its class.

    Parameters
    ----------
    signature : ModalSignature
    label : str
        Name of the class.
    subject : str or None
        Who was recorded: cases of one subject are never on both sides of a split. None for a
        subject of its own.
    """

    signature: ModalSignature
    label: str
    subject: str | None = None


@shown()
@dataclass(frozen=True)
class CaseFile:
    """A training case whose signature lies in a file, and is read where it is worked on.

    Parameters
    ----------
    path : Path
        As `store.signature_to_hdf5` wrote it; workers on other machines must see it too.
    sequence_id : str
        Of the signature in it, for errors.
    label : str
    subject : str or None
        As in `TrainingCase`.
    """

    path: Path
    sequence_id: str
    label: str
    subject: str | None = None

    def read(self) -> TrainingCase:
        """Read the signature.

        Raises
        ------
        NotFoundError, StoreError
            If it cannot be read; `details` name the sequence.
        """
        # The store keeps classifications, so it imports this package.
        from modalmotion.signature.hdf5 import signature_from_hdf5

        try:
            signature = signature_from_hdf5(self.path)
        except ModalMotionError as error:
            named = copy.copy(error)
            named.details = {**error.details, "sequence_id": self.sequence_id}
            raise named from error
        return TrainingCase(signature, self.label, self.subject)
