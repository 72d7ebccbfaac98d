"""Training cases read wherever joblib works, a few at a time."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

from modalmotion.classification.options import FEWER_MODES, OnError, TrainingOptions
from modalmotion.classification.training.case_row import CaseRow, case_row
from modalmotion.classification.training.cases import AnyCase, TrainingCase
from modalmotion.classification.training.feature_choices import mixes
from modalmotion.classification.training.left_out import UNUSABLE, LeftOut
from modalmotion.errors import ParameterError, UnlikeCasesError
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
    name : str
        What errors call the case; may be empty.
    surface : str
    parameters : SignatureParameters
    modes : Modes
    signature : ModalSignature or None
        Of the first case only.
    is_fitted : bool
        Whether it came as a sequence.
    """

    row: CaseRow
    name: str
    surface: str
    parameters: SignatureParameters
    modes: Modes
    signature: ModalSignature | None
    is_fitted: bool


def read_cases(
    cases: Iterable[AnyCase], options: TrainingOptions, parameters: SignatureParameters
) -> Iterator[ReadCase | LeftOut]:
    """Read cases, in their order; with `on_error` "leave out", go on without those that fail.

    Parameters
    ----------
    cases : iterable of TrainingCase or CaseSource
    options : TrainingOptions
    parameters : SignatureParameters
        Of the signatures of sequences.

    Raises
    ------
    ParameterError
        If one of them cannot be used.
    ModalMotionError
        If one cannot be read or fitted.

    Yields
    ------
    ReadCase or LeftOut
    """
    from joblib import Parallel, delayed

    numbered = enumerate(cases)
    pieces = iter(lambda: tuple(itertools.islice(numbered, _IN_ONE_PIECE)), ())
    works = (delayed(_read_piece)(piece, options, parameters) for piece in pieces)
    results = Parallel(return_as="generator", batch_size=1)(works)
    return itertools.chain.from_iterable(results)


def _read_piece(
    piece: tuple[tuple[int, AnyCase], ...],
    options: TrainingOptions,
    parameters: SignatureParameters,
) -> list[ReadCase | LeftOut]:
    results: list[ReadCase | LeftOut] = []
    for number, source in piece:
        try:
            read = source if isinstance(source, TrainingCase) else source.read()
            case = read.fitted(parameters, FEWER_MODES if options.modes is None else ())
            require_usable(case, number, options)
        except UNUSABLE as error:
            if options.on_error == OnError.RAISE:
                raise
            results.append(LeftOut.of(error, source.name or f"case {number}"))
            continue
        signature = case.signature
        results.append(
            ReadCase(
                case_row(case, options),
                case.name,
                signature.surface,
                signature.parameters,
                signature.modes,
                None if number else signature,
                read is not case,
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
    called = f"The training case {case.name or number}"
    if not str(case.label or "").strip():
        raise ParameterError(
            f"{called} has no label.",
            remedy="Give every case the name of its class, or leave it out.",
            details={"case": number, "sequence_id": signature.sequence_id},
        )
    if signature.n_frames < 2:
        raise ParameterError(
            f"{called} has one frame, which shows no motion.",
            remedy="Leave it out.",
            details={"case": number, "sequence_id": signature.sequence_id},
        )
    if options.modes is not None and options.modes not in (
        signature.parameters.modes,
        len(signature.modes),
    ):
        raise ParameterError(
            f"{called} has {len(signature.modes)} modes, but the options say {options.modes}.",
            remedy=f"Fit the signatures with modes={options.modes}.",
            details={"case": number, "sequence_id": signature.sequence_id},
        )


def basis_of(case: ReadCase | ModalSignature) -> tuple[Any, ...]:
    """Give what two cases must share so that their modes compare; last, what spring modes must."""
    p = case.parameters
    return (
        *(p.kind, p.weights, p.remove_rotation, p.components, p.reference == MEAN),
        *(case.modes.topology is None, case.modes.connectivity_id),
    )


def require_alike(case: ReadCase, example: ReadCase, number: int) -> None:
    """Check that a case has the modes of the first.

    Raises
    ------
    UnlikeCasesError
        Naming the case.
    """
    called = case.name or str(number)
    # Where recordings were fitted here, as many modes are read as all of them have.
    fits = case.is_fitted and example.is_fitted
    a, b = case.parameters, example.parameters
    if a.kind != b.kind:
        raise UnlikeCasesError(
            f"The training case {called} has a signature of the kind {a.kind}, the first one of "
            f"the kind {b.kind}: displacements of points and offsets of a surface do not compare.",
            remedy="Give the sequences themselves, with the option kind, or signatures of one "
            "kind.",
            details={"case": number, "sequence_id": case.row.sequence_id},
        )
    # Surfaces that do not mix are named together, when all cases are known.
    parted = not mixes({case.surface, example.surface})
    same = basis_of(case)[:-1] == basis_of(example)[:-1] and (
        fits or parted or len(case.modes) == len(example.modes)
    )
    if same and case.modes.connectivity_id != example.modes.connectivity_id:
        raise UnlikeCasesError(
            f"The training case {called} is of another mesh than the first, and spring modes "
            "compare within one mesh only.",
            remedy="Give recordings of one mesh, or of surfaces with natural coordinates.",
            details={"case": number, "sequence_id": case.row.sequence_id},
        )
    if not same:
        raise UnlikeCasesError(
            f"The training cases differ in their modes: case {called} has {len(case.modes)} "
            f"of a {case.surface}, {a.components}, weights {a.weights}, reference {a.reference}; "
            f"the first has {len(example.modes)} of a {example.surface}, {b.components}, weights "
            f"{b.weights}, reference {b.reference}.",
            remedy="Fit all signatures with the same parameters, or give the sequences themselves: "
            "training then fits all of them in one basis.",
            details={"case": number, "sequence_id": case.row.sequence_id},
        )
