"""Labelled recordings that models are trained and tested on."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

from modalmotion import errors, mesh, notes
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import counted, shown
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature

UNUSABLE: Final = (errors.InputError, errors.NotFoundError, errors.CorruptFileError)
"""Errors of one case. Others, such as a full disk, are of all cases and end a training."""

# Cases that a card names; a longer list is a matter for the sender's own tables.
_MOST_NAMED: Final = 20


@shown("label", "subject", "sequence_id")
@dataclass(frozen=True, eq=False)
class TrainingCase:
    """One recording with its class.

    Parameters
    ----------
    motion : MeshSequence or ModalSignature
        A sequence is fitted in training, in the basis of the whole cohort; a signature is read as
        it is.
    label : str
        Name of the class.
    subject : str or None
        Who was recorded: cases of one subject are never on both sides of a split. None for a
        subject of its own.
    name : str
        What errors call it, such as the path of its file.
    covariates : mapping of str to (float or str)
        Other knowledge, such as an age; over that of the recording's facts, which it becomes.
    sequence : function, optional
        Reads the recording that a signature was made from, for the volumes of a norm; it gives
        None where its vertices are not kept.
    """

    motion: MeshSequence | ModalSignature
    label: str
    subject: str | None = None
    name: str = ""
    covariates: Mapping[str, float | str] = field(default_factory=dict)
    sequence: Callable[[], MeshSequence | None] | None = None

    def __post_init__(self) -> None:
        facts = mesh.Facts(covariates=self.covariates).over(self.motion.facts)
        if facts != self.motion.facts:
            object.__setattr__(self, "motion", replace(self.motion, facts=facts))
        object.__setattr__(self, "covariates", self.motion.facts.covariates)

    @property
    def sequence_id(self) -> str:
        """Id of the recording."""
        motion = self.motion
        return motion.id if isinstance(motion, MeshSequence) else motion.sequence_id

    @property
    def signature(self) -> ModalSignature:
        """Its signature.

        Raises
        ------
        ParameterError
            If it is a sequence, which must be fitted first.
        """
        if isinstance(self.motion, MeshSequence):
            raise errors.ParameterError(
                "A sequence has no signature yet.", remedy="Fit it with `fitted`."
            )
        return self.motion

    def read_sequence(self) -> MeshSequence | None:
        """Give the recording itself, where it is known."""
        if isinstance(self.motion, MeshSequence):
            return self.motion
        return None if self.sequence is None else self.sequence()

    def fitted(self, parameters: SignatureParameters, fewer: Sequence[int] = ()) -> "TrainingCase":
        """Fit a sequence; a signature stays what it is.

        Parameters
        ----------
        parameters : SignatureParameters
        fewer : sequence of int
            Numbers of modes that are tried, one after another, where its vertices cannot tell
            as many apart as the parameters name.

        Raises
        ------
        ModalMotionError
            If it cannot be fitted; it names the case.
        """
        if not isinstance(self.motion, MeshSequence):
            return self
        try:
            return replace(self, motion=modal_signature(self.motion, parameters))
        except errors.ModalMotionError as error:
            if fewer and isinstance(error, errors.ModeCountError):
                return self.fitted(replace(parameters, modes=fewer[0]), fewer[1:])
            raise errors.named(error, self.name) from error


@shown()
@dataclass(frozen=True)
class CaseFile:
    """A training case whose signature is in a file, and is read where it is worked on.

    Parameters
    ----------
    path : Path
        As `store.signature_to_hdf5` wrote it; workers on other machines must see it too.
    sequence_id : str
        Of the signature in it, for errors.
    label : str
    subject : str or None
    covariates : mapping of str to (float or str)
        As in `TrainingCase`.
    """

    path: Path
    sequence_id: str
    label: str
    subject: str | None = None
    covariates: Mapping[str, float | str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """What errors call it: its sequence."""
        return case_name(self.sequence_id)

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
        except errors.ModalMotionError as error:
            raise errors.named(error, "", sequence_id=self.sequence_id) from error
        return TrainingCase(signature, self.label, self.subject, covariates=self.covariates)


class CaseSource(Protocol):
    """What gives a training case when it is read, such as a file; it must be pickled."""

    @property
    def name(self) -> str:
        """What errors call the case, such as the path of its file; may be empty."""

    def read(self) -> TrainingCase:
        """Read the case."""


AnyCase = TrainingCase | CaseSource


def as_case(item: Any, number: int) -> TrainingCase:
    """Take a recording, or what reads one, for a case; what has no name is called by its number.

    Raises
    ------
    ParameterError
        If it is no recording.
    """
    case = item.read() if hasattr(item, "read") else item
    if isinstance(case, MeshSequence | ModalSignature):
        case = TrainingCase(case, "")
    if not isinstance(case, TrainingCase):
        raise errors.ParameterError(
            f"Case {number} is a {type(case).__name__}, not a recording.",
            remedy="Give MeshSequences, ModalSignatures or TrainingCases.",
            details={"case": number},
        )
    return case if case.name else replace(case, name=f"case {number}")


def case_name(sequence_id: str) -> str:
    """Give what errors call a case without a file."""
    return f"Sequence {sequence_id[:12]}"


class LeftOut(NamedTuple):
    """A case that was left out, and why.

    Parameters
    ----------
    name : str
        What errors call the case, such as the path of its file.
    reason : str
    """

    name: str
    reason: str

    @staticmethod
    def of(error: errors.ModalMotionError, name: str) -> "LeftOut":
        """Leave a case out for an error, which may name it already."""
        return LeftOut(name, error.message.removeprefix(f"{name}: "))

    def __str__(self) -> str:
        return f"{self.name}: {self.reason}"


def left_out_notes(cases: Sequence[LeftOut]) -> tuple[notes.Note, ...]:
    """Name the cases that were left out, for a card or a summary."""
    if not cases:
        return ()
    more = len(cases) - _MOST_NAMED
    return (
        notes.Note.of("cases_left_out", n_cases=len(cases)),
        *(notes.Note.of("case_left_out", case=str(case)) for case in cases[:_MOST_NAMED]),
        *((notes.Note.of("cases_also_left_out", cases=counted(more, "case")),) if more > 0 else ()),
    )
