"""One basis for a cohort: modes in which all its recordings compare."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.training.cases import AnyCase
from modalmotion.classification.training.table import CaseTable, collect
from modalmotion.errors import (
    ModalMotionError,
    ModeCountError,
    TopologyError,
    UnlikeCasesError,
)


def collect_in_one_basis(
    cases: Iterable[AnyCase],
    options: TrainingOptions,
    progress: Callable[[int], None] | None = None,
) -> CaseTable:
    """Read the features of a cohort, in modes that all its recordings share.

    Each recording is fitted as its own shape says. Where that gives modes that do not compare,
    as on closed surfaces of which some have an axis that bends, and all are of one mesh, all of
    them are fitted again with the spring modes of that mesh.

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
    try:
        return collect(cohort, options, progress)
    except UnlikeCasesError as unlike:
        if options.topology is not None:
            raise
        springs = replace(options.signature_parameters, closed_form=False)
        try:
            table = collect(cohort, options, progress, springs)
        except (UnlikeCasesError, TopologyError, ModeCountError) as error:
            raise _neither(unlike, error) from error
    note = (
        "The shapes of these recordings have no topology in common, and all are of one mesh: all "
        "are fitted with its spring modes. State a topology to decide otherwise."
    )
    return replace(table, notes=(note, *table.notes))


def _neither(unlike: UnlikeCasesError, error: ModalMotionError) -> UnlikeCasesError:
    """Say why cases compare neither as they are nor by the springs of their mesh."""
    if error.message == unlike.message:
        return unlike
    return UnlikeCasesError(
        f"{unlike.message} As spring modes they do not compare either: {error.message}",
        remedy=unlike.remedy,
        details={**error.details, **unlike.details},
    )
