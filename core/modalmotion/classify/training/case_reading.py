"""Training cases read wherever joblib works, a few at a time."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from modalmotion.classify.case_checks import require_usable
from modalmotion.classify.options import TrainingOptions
from modalmotion.classify.training.case_row import CaseRow, case_row
from modalmotion.classify.training.cases import CaseFile, TrainingCase
from modalmotion.mesh.spring_modes import SpringSpectrum
from modalmotion.modes import ModeSet
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
    modes : ModeSet or SpringSpectrum
    signature : ModalSignature or None
        Of the first case only.
    """

    row: CaseRow
    surface: str
    parameters: SignatureParameters
    modes: ModeSet | SpringSpectrum
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
