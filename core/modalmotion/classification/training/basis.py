"""One basis for a cohort: modes in which all its recordings compare."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from dataclasses import replace

from modalmotion.classification.options import OnError, TrainingOptions
from modalmotion.classification.training.cases import AnyCase, TrainingCase
from modalmotion.classification.training.collection import collect
from modalmotion.classification.training.table import CaseTable
from modalmotion.errors import (
    ModalMotionError,
    ModeCountError,
    ParameterError,
    TopologyError,
    UnlikeCasesError,
)
from modalmotion.signature.making import ModalSignature

# Cases that an error names.
_MOST_NAMED = 3


def collect_in_one_basis(
    cases: Iterable[AnyCase],
    options: TrainingOptions,
    progress: Callable[[int], None] | None = None,
) -> CaseTable:
    """Read the features of a cohort, in modes that all its recordings share.

    Each recording is fitted as its own shape says. Where that gives modes that do not compare,
    as on closed surfaces of which some have an axis that bends, and all are of one mesh, all of
    them are fitted again with the spring modes of that mesh. With `on_error` "leave out" it is
    the basis that leaves fewer out.

    Parameters
    ----------
    cases : iterable of TrainingCase or CaseSource
        Sequences are fitted; signatures are taken as they are.
    options : TrainingOptions
        With a topology, that one alone is tried.
    progress : callable, optional
        Called with the number of cases that have been read.

    Raises
    ------
    UnlikeCasesError
        If there is no such basis.
    ModalMotionError
        If a case cannot be read or fitted.
    """
    # They may be read twice.
    cohort = list(cases) if iter(cases) is cases else cases
    springs = replace(options.signature_parameters, closed_form=False)
    if options.on_error == OnError.LEAVE_OUT:
        table = collect(cohort, options, progress, drops_unlike=True)
        if options.topology is not None or not table.left_out:
            return table
        with contextlib.suppress(ParameterError):
            other = collect(cohort, options, progress, springs, drops_unlike=True)
            if len(other.left_out) < len(table.left_out):
                return _with_note(other)
        return table
    try:
        return collect(cohort, options, progress)
    except UnlikeCasesError as unlike:
        if options.topology is not None:
            raise
        try:
            table = collect(cohort, options, progress, springs)
        except (UnlikeCasesError, TopologyError, ModeCountError) as error:
            raise _neither(unlike, error, cohort, options) from error
    return _with_note(table)


def _with_note(table: CaseTable) -> CaseTable:
    note = (
        "By their shapes these recordings have several topologies, and all are of one mesh: all "
        "are fitted with its spring modes. State a topology to decide otherwise."
    )
    return replace(table, notes=(note, *table.notes))


def _neither(
    unlike: UnlikeCasesError,
    error: ModalMotionError,
    cohort: Iterable[AnyCase],
    options: TrainingOptions,
) -> UnlikeCasesError:
    """Say why cases compare neither as they are nor by the springs of their mesh.

    And which are odd: those that would be left out, for the first that differs need not be.
    """
    message, remedy = unlike.message, unlike.remedy
    if error.message != unlike.message:
        message += f" As spring modes they do not compare either: {error.message}"
    details = {**error.details, **unlike.details}
    with contextlib.suppress(ModalMotionError):
        leaving = replace(options, on_error=OnError.LEAVE_OUT)
        odd = [case.name for case in collect_in_one_basis(cohort, leaving).left_out]
        names = ", ".join(odd[:_MOST_NAMED]) + (", and others" if len(odd) > _MOST_NAMED else "")
        # Signatures may have been fitted unlike; sequences are all fitted here.
        has_signature = any(
            isinstance(case, TrainingCase) and isinstance(case.motion, ModalSignature)
            for case in cohort
        )
        remedy = (
            f"{f'{remedy} Or leave' if has_signature else 'Leave'} out what does not compare with "
            f"most ({len(odd)}: {names}), which --skip-unreadable does, or on_error = "
            '"leave out". Or state one topology for all (topology), if that is what the surfaces '
            "are."
        )
        details["left_out"] = odd[:20]
    return UnlikeCasesError(message, remedy=remedy, details=details)
