"""What a worker does of a cohort: some files at a time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from modalmotion.errors import ModalMotionError
from modalmotion.formats import ParserHere, ReadOptions, read_sequence
from modalmotion.signature import SignatureParameters, modal_signature
from modalmotion.store import (
    SequenceRecord,
    record_of,
    sequence_to_hdf5,
    signature_to_hdf5,
    template_from_hdf5,
)
from modalmotion_service.tasks import write_whole


@dataclass(frozen=True)
class Item:
    """A file, and where what is made of it goes.

    Parameters
    ----------
    path : Path
    signature : Path
    vertices : Path or None
        None if they are not kept.
    """

    path: Path
    signature: Path
    vertices: Path | None


@dataclass(frozen=True)
class Signed:
    """A file that was understood.

    Parameters
    ----------
    record : SequenceRecord
    rms_error : float
    """

    record: SequenceRecord
    rms_error: float


@dataclass(frozen=True)
class Refused:
    """A file that was not.

    Parameters
    ----------
    code, reason : str
    """

    code: str
    reason: str


def sign_batch(
    items: tuple[Item, ...],
    options: ReadOptions,
    parameters: SignatureParameters,
    template: Path | None,
) -> list[Signed | Refused]:
    """Write the signature of each file; what is wrong with one does not concern the others."""
    named = None if template is None else template_from_hdf5(template)
    # This process may be lost and is limited from outside: parsers need none of their own.
    parser = ParserHere(options.limits)
    outcomes: list[Signed | Refused] = []
    for item in items:
        try:
            sequence = read_sequence(item.path, options, parser=parser).sequence
            signature = modal_signature(sequence, parameters, template=named)
        except ModalMotionError as error:
            outcomes.append(Refused(error.code, str(error)))
            continue
        if item.vertices is not None:
            write_whole(item.vertices, sequence_to_hdf5(sequence))
        write_whole(item.signature, signature_to_hdf5(signature))
        record = record_of(sequence, created="", has_upload=item.vertices is not None)
        outcomes.append(Signed(record, signature.rms_error))
    return outcomes
