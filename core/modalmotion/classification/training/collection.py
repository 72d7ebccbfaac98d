"""Collecting labelled recordings into a table of their features."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from modalmotion.classification.covariates import features_of
from modalmotion.classification.model.model import Readable
from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.training.case_groups import group_cases
from modalmotion.classification.training.case_row import CaseRow
from modalmotion.classification.training.cases import AnyCase
from modalmotion.classification.training.cohort_notes import cohort_notes
from modalmotion.classification.training.feature_choices import (
    domain_reader,
    feature_choices,
    tells_walls,
)
from modalmotion.classification.training.kept_cases import KeptCases, keep_cases
from modalmotion.classification.training.left_out import left_out_notes
from modalmotion.classification.training.own_folds import Fold, folds_by
from modalmotion.classification.training.table import CaseTable
from modalmotion.errors import ParameterError, UnlikeCasesError
from modalmotion.mesh.sequence import MEAN
from modalmotion.signature.first_modes import first_modes
from modalmotion.signature.making import ModalSignature, SignatureParameters
from modalmotion.template import GivenLandmarks


def collect(
    cases: Iterable[AnyCase],
    options: TrainingOptions,
    progress: Callable[[int], None] | None = None,
    parameters: SignatureParameters | None = None,
    *,
    drops_unlike: bool = False,
) -> CaseTable:
    """Read the features of labelled recordings, a few at a time, wherever joblib works.

    Parameters
    ----------
    cases : iterable of TrainingCase or CaseSource
    options : TrainingOptions
    progress : callable, optional
        Called with the number of cases that have been read.
    parameters : SignatureParameters, optional
        Of the signatures of sequences; those of the options by default.
    drops_unlike : bool
        Whether cases that do not compare with most are left out.

    Raises
    ------
    UnlikeCasesError
        If their modes do not compare.
    ParameterError
        If a label is missing, a signature cannot be used or is of another kind than the
        others, one recording has two classes, or there are fewer than two classes.
    """
    fitting = options.signature_parameters if parameters is None else parameters
    kept = keep_cases(cases, options, fitting, progress, drops_unlike=drops_unlike)
    example = kept.example(cases, options, fitting)
    try:
        return _collected(kept, example, options)
    except UnlikeCasesError:
        if not drops_unlike:
            raise
        kept = kept.of_one_surface()
        return _collected(kept, kept.example(cases, options, fitting), options)


def _collected(
    kept: KeptCases, example: ModalSignature | None, options: TrainingOptions
) -> CaseTable:
    rows: list[CaseRow] = []
    numbers: list[int] = []
    by_id: dict[str, list[CaseRow]] = {}
    labels: dict[str, CaseRow] = {}
    topologies: dict[str, list[tuple[str, str]]] = {}
    for number, case in zip(kept.numbers, kept.cases, strict=True):
        row = case.row
        known = labels.setdefault(row.sequence_id, row)
        if known.label != row.label:
            what = f"The recording {row.sequence_id[:12]}"
            if row.name and known.name:
                both = f"{known.name} and {row.name} are one recording, which"
                what = row.name if row.name == known.name else both
            raise ParameterError(
                f"{what} has two classes, {known.label!r} and {row.label!r}.",
                remedy="Give each recording one class.",
                details={"case": number, "sequence_id": row.sequence_id},
            )
        topologies.setdefault(case.surface, []).append((row.sequence_id, case.name))
        # The same recording with the same modes says nothing new; as another topology it does.
        same = by_id.setdefault(row.sequence_id, [])
        if not any(_is_same(r, row) for r in same):
            rows.append(row)
            numbers.append(number)
            same.append(row)
    if example is not None:
        # Some recordings may have too few vertices for as many modes as others.
        n = min(row.counts[-1] for row in rows)
        example = first_modes(replace(example, parameters=replace(example.parameters, modes=n)), n)
    classes = tuple(sorted({row.label for row in rows}))
    if example is None or len(classes) < 2:
        without = f", without the {len(kept.left_out)} that were left out" if kept.left_out else ""
        raise ParameterError(
            f"The training cases have {len(classes)} class(es){without}.",
            remedy="Give cases of at least two classes.",
            details={"classes": list(classes), "left_out": [str(c) for c in kept.left_out[:20]]},
        )
    options.require_classes(classes)
    n_same = len(kept.cases) - len(rows)
    notes = [f"{n_same} cases came twice and counted once."] if n_same else []
    most = options.signature_parameters.modes
    if options.modes is None and any(case.is_fitted for case in kept.cases) and n < (most or 0):
        notes.append(
            f"Some recordings have too few vertices for {most} modes: {n} are read of all."
        )
    notes += cohort_notes(rows)
    table = _table(rows, classes, example, topologies, options, notes)
    own: tuple[Fold, ...] = ()
    if options.fold is not None:
        own = folds_by(options.fold, [row.covariates for row in rows], numbers)
    return replace(
        table,
        is_fitted=all(case.is_fitted for case in kept.cases),
        numbers=np.array(numbers),
        own_folds=own,
        n_given=len(kept.cases) + len(kept.left_out),
        left_out=kept.left_out,
        notes=(*left_out_notes(kept.left_out), *table.notes),
    )


def _is_same(a: CaseRow, b: CaseRow) -> bool:
    """Whether two readings of one recording are the same."""
    return a.terms.keys() == b.terms.keys() and all(
        np.array_equal(terms.terms, b.terms[key].terms) for key, terms in a.terms.items()
    )


def _table(
    rows: list[CaseRow],
    classes: tuple[str, ...],
    example: ModalSignature,
    topologies: dict[str, list[tuple[str, str]]],
    options: TrainingOptions,
    notes: list[str],
) -> CaseTable:
    walls = tells_walls(rows, options)
    readers = feature_choices(rows, example, options, walls, topologies)
    if not readers:
        common, *rare = sorted(topologies, key=lambda name: -len(topologies[name]))
        rarely = [case for topology in rare for case in topologies[topology]]
        names = [name or sequence_id[:12] for sequence_id, name in rarely]
        raise UnlikeCasesError(
            f"The training cases have the topologies {', '.join(sorted(topologies))}: most are "
            f"{common}, and {len(names)} are not, such as {', '.join(names[:3])}.",
            remedy="Leave those out, or state one topology for all (topology); only cups and "
            "cylinders over a cycle mix.",
            details={"sequence_ids": [id_ for id_, _ in rarely[:20]], "n_sequences": len(rarely)},
        )
    subjects, groups, mixed = group_cases(rows, options.groups)
    if mixed:
        notes = [*notes, f"{mixed} recordings are of two subjects each; these are kept together."]
    lines = sorted(f"{r.sequence_id} {r.label} {s}" for r, s in zip(rows, subjects, strict=True))
    units = {row.has_unit for row in rows}
    reference = example.parameters.reference
    parameters = replace(
        example.parameters,
        template=None,
        landmarks=GivenLandmarks(),
        grid=None,
        reference=MEAN if reference == MEAN else 0,
    )
    return CaseTable(
        example=example,
        readable=Readable(
            topologies=tuple(sorted(topologies)),
            n_modes=len(example.modes),
            connectivity_id=example.modes.connectivity_id,
            parameters=parameters,
        ),
        domain_reader=domain_reader(readers),
        readers=readers,
        classes=classes,
        y=np.array([classes.index(row.label) for row in rows]),
        groups=groups,
        subjects=subjects,
        sequence_ids=tuple(row.sequence_id for row in rows),
        names=tuple(row.name for row in rows),
        conditions=tuple(row.conditions for row in rows),
        hash=hashlib.sha256("\n".join(lines).encode()).hexdigest(),
        rows=tuple(rows),
        covariates=features_of([row.covariates for row in rows], options),
        notes=tuple(notes),
        allowed=np.stack([row.allowed for row in rows]),
        measures=np.stack([row.measures for row in rows]),
        has_unit=units.pop() if len(units) == 1 else None,
        hand_is_stated=all(row.hand_is_stated for row in rows),
        trackings=frozenset(row.tracking for row in rows),
    )


def class_counts(labels: Iterable[str]) -> dict[str, int]:
    """How often each label occurs, sorted by label."""
    return dict(sorted(Counter(labels).items()))
