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
    """A case as a worker read it.

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
    results = Parallel(return_as="generator", batch_size=1)(works)
    return itertools.chain.from_iterable(results)


def _read_piece(
    piece: tuple[tuple[int, TrainingCase | CaseFile], ...], options: TrainingOptions
) -> list[ReadCase]:
    results = []
    for number, source in piece:
        case = source.read() if isinstance(source, CaseFile) else source
        require_usable(case, number, options)
        signature = case.signature
        results.append(
            ReadCase(
                case_row(case, options),
                signature.surface,
                signature.parameters,
                signature.modes,
                None if number else signature,
            )
        )
    return results


def require_usable(case: TrainingCase, number: int, options: TrainingOptions) -> None:
    """Check that a case has a label, a motion and the modes of the options.

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
    if options.modes not in (signature.parameters.modes, len(signature.modes)):
        raise ParameterError(
            f"The training case {number} has {len(signature.modes)} modes, but the "
            f"options say {options.modes}.",
            remedy=f"Fit the signatures with modes={options.modes}.",
            details={"case": number, "sequence_id": signature.sequence_id},
        )


def require_alike(case: ReadCase, example: ReadCase, number: int) -> None:
    """Check that a case has the modes of the first.

    Raises
    ------
    ParameterError
        Naming the case.
    """
    a, b = case.parameters, example.parameters
    same = (
        a.weights == b.weights
        and a.remove_rotation == b.remove_rotation
        and a.components == b.components
        and (a.reference == MEAN) == (b.reference == MEAN)
        and len(case.modes) == len(example.modes)
        and (case.modes.topology is None) == (example.modes.topology is None)
    )
    if same and case.modes.connectivity_id != example.modes.connectivity_id:
        raise ParameterError(
            f"The training case {number} is of another mesh than the first, and spring modes "
            "compare within one mesh only.",
            remedy="Give recordings of one mesh, or of surfaces with natural coordinates.",
            details={"case": number, "sequence_id": case.row.sequence_id},
        )
    if not same:
        raise ParameterError(
            f"The training cases differ in their modes: case {number} has {len(case.modes)} "
            f"of a {case.surface}, {a.components}, weights {a.weights}, reference {a.reference}; "
            f"the first has {len(example.modes)} of a {example.surface}, {b.components}, weights "
            f"{b.weights}, reference {b.reference}.",
            remedy="State one topology for all (--topology, or in their files) where it fits, or "
            "leave this case out."
            if case.surface != example.surface
            else "Fit all signatures with the same parameters, or leave this case out.",
            details={"case": number, "sequence_id": case.row.sequence_id},
        )
