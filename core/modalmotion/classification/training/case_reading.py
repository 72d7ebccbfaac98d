"""Training cases read wherever joblib works, a few at a time."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.training.case_row import CaseRow, case_row
from modalmotion.classification.training.cases import CaseFile, TrainingCase
from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import MEAN
from modalmotion.modes import Modes
from modalmotion.signature.making import ModalSignature, SignatureParameters

# Cases that are read in one piece of work: some 0.1 s of it.
_IN_ONE_PIECE: Final = 16


@dataclass(frozen=True, eq=False)
class ReadCase:
    """A case as read by whoever did the work.

    Parameters
    ----------
    row : CaseRow
    surface : str
    parameters : SignatureParameters
    modes : Modes
    signature : ModalSignature or None
        Of the first case only.
    """

    row: CaseRow
    surface: str
    parameters: SignatureParameters
    modes: Modes
    signature: ModalSignature | None


def read_cases(
    cases: Iterable[TrainingCase | CaseFile], options: TrainingOptions
) -> Iterator[ReadCase]:
    """Read cases, in their order.

    Raises
    ------
    ParameterError
        If one of them cannot be used.
    """
    from joblib import Parallel, delayed

    numbered = enumerate(cases)
    pieces = iter(lambda: tuple(itertools.islice(numbered, _IN_ONE_PIECE)), ())
    works = (delayed(_read_piece)(piece, options) for piece in pieces)
    read = Parallel(return_as="generator", batch_size=1)(works)
    return itertools.chain.from_iterable(read)


def _read_piece(
    piece: tuple[tuple[int, TrainingCase | CaseFile], ...], options: TrainingOptions
) -> list[ReadCase]:
    found = []
    for number, given in piece:
        case = given.read() if isinstance(given, CaseFile) else given
        require_usable(case, number, options)
        signature = case.signature
        found.append(
            ReadCase(
                case_row(case, options),
                signature.surface,
                signature.parameters,
                signature.modes,
                None if number else signature,
            )
        )
    return found


def require_usable(case: TrainingCase, number: int, options: TrainingOptions) -> None:
    """Check that a case has a label, a motion and the modes that are asked for.

    Raises
    ------
    ParameterError
        Naming the case.
    """
    signature = case.signature
    if not str(case.label or "").strip():
        raise ParameterError(
            f"The training case {number} has no label.",
            remedy="Give every case the name of its class, or leave it out.",
            details={"case": number, "sequence_id": signature.sequence_id},
        )
    if signature.n_frames < 2:
        raise ParameterError(
            f"The training case {number} has one frame, which shows no motion.",
            remedy="Leave it out.",
            details={"case": number, "sequence_id": signature.sequence_id},
        )
    asked = signature.parameters.modes
    if options.modes not in (asked, len(signature.modes)):
        raise ParameterError(
            f"The training case {number} has {len(signature.modes)} modes, but {options.modes} "
            "were asked for.",
            remedy=f"Fit the signatures with modes={options.modes}.",
            details={"case": number, "sequence_id": signature.sequence_id},
        )


def require_alike(read: ReadCase, example: ReadCase, number: int) -> None:
    """Check that a case has the modes of the first.

    Raises
    ------
    ParameterError
        Naming the case.
    """
    a, b = read.parameters, example.parameters
    same = (
        a.weights == b.weights
        and a.remove_rotation == b.remove_rotation
        and a.components == b.components
        and (a.reference == MEAN) == (b.reference == MEAN)
        and len(read.modes) == len(example.modes)
        and (read.modes.topology is None) == (example.modes.topology is None)
    )
    if same and read.modes.connectivity_id != example.modes.connectivity_id:
        raise ParameterError(
            f"The training case {number} is of another mesh than the first, and spring modes "
            "compare within one mesh only.",
            remedy="Give recordings of one mesh, or of surfaces with natural coordinates.",
            details={"case": number, "sequence_id": read.row.sequence_id},
        )
    if not same:
        raise ParameterError(
            f"The training cases differ in their modes: case {number} has {len(read.modes)} "
            f"of a {read.surface}, {a.components}, weights {a.weights}, reference {a.reference}; "
            f"the first has {len(example.modes)} of a {example.surface}, {b.components}, weights "
            f"{b.weights}, reference {b.reference}.",
            remedy="Fit all signatures with the same parameters.",
            details={"case": number, "sequence_id": read.row.sequence_id},
        )
