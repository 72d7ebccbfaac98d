"""The table of a training set: features of labelled signatures, nothing else."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.covariates import features_of
from modalmotion.classification.features import (
    Column,
    FeatureReader,
    Further,
    covariate_columns,
    kind_of,
    mean_motion,
    powers_of,
)
from modalmotion.classification.features.hand import theta_is_of_the_shape
from modalmotion.classification.features.twins import of_kinds, twin_signs
from modalmotion.classification.model.domain import Sights, sights_of
from modalmotion.classification.model.model import Readable
from modalmotion.classification.options import PoseOf, TrainingOptions
from modalmotion.classification.training.case_groups import group_cases
from modalmotion.classification.training.case_row import CaseRow, FurtherKey, TermsKey
from modalmotion.classification.training.cases import AnyCase
from modalmotion.classification.training.conditions import Conditions
from modalmotion.classification.training.feature_choices import (
    domain_reader,
    feature_choices,
    tells_walls,
)
from modalmotion.classification.training.kept_cases import KeptCases, keep_cases
from modalmotion.classification.training.left_out import LeftOut, left_out_notes
from modalmotion.classification.training.own_folds import Fold, folds_by
from modalmotion.errors import ParameterError, UnlikeCasesError
from modalmotion.mesh.sequence import MEAN
from modalmotion.signature.first_modes import first_modes
from modalmotion.signature.making import ModalSignature, SignatureParameters
from modalmotion.template import GivenLandmarks

# Motions that the typical one is made of; more cost time and move it little.
_MOST_TYPICAL: Final = 200


@dataclass(frozen=True, eq=False)
class CaseTable:
    """Features of a training set.

    Parameters
    ----------
    example : ModalSignature
        One of them, for its modes.
    readable : Readable
    domain_reader : FeatureReader
        Of the domain, whichever choice of features is made.
    readers : tuple of FeatureReader
        Choices of features that may be tried, without a typical motion yet.
    classes : tuple of str
    y : (cases,) int64
    groups : (cases,) int64
        Cases that must not be on both sides of a split.
    subjects : tuple of str
    sequence_ids, names : tuple of str
    conditions : tuple of Conditions
    hash : str
        sha256 in hex of ids, labels and subjects, in any order.
    rows : tuple of CaseRow
        What was read of each case.
    covariates : tuple of mapping of str to (float or str)
        Of each case, those that may be features; what is unknown is missing.
    notes : tuple of str
    allowed : (cases, readings) bool
        See `readings_of`; of one reading where there is no axis.
    measures : (cases, measures) float64
        See `course.measures`.
    has_unit : bool or None
        Whether lengths have a unit; None where they have in some.
    hand_is_stated : bool
        Whether all cases state their handedness.
    trackings : frozenset of str
        What the cases state of their points.
    is_fitted : bool
        Whether all cases came as sequences.
    numbers : (cases,) int64
        Of each case, as it was given.
    n_given : int
        Number of cases that were given.
    left_out : tuple of LeftOut
    own_folds : tuple of ((n,) int64, (m,) int64)
        The user's own; none where folds are drawn.
    """

    example: ModalSignature
    readable: Readable
    domain_reader: FeatureReader
    readers: tuple[FeatureReader, ...]
    classes: tuple[str, ...]
    y: NDArray[np.int64]
    groups: NDArray[np.int64]
    subjects: tuple[str, ...]
    sequence_ids: tuple[str, ...]
    names: tuple[str, ...]
    conditions: tuple[Conditions, ...]
    hash: str
    rows: tuple[CaseRow, ...]
    covariates: tuple[Mapping[str, float | str], ...]
    notes: tuple[str, ...]
    allowed: NDArray[np.bool_]
    measures: NDArray[np.float64]
    has_unit: bool | None
    hand_is_stated: bool
    trackings: frozenset[str]
    is_fitted: bool = False
    numbers: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    n_given: int = 0
    left_out: tuple[LeftOut, ...] = ()
    own_folds: tuple[Fold, ...] = ()
    _cache: dict[tuple[object, ...], NDArray[np.float64]] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.y)

    def fitted(
        self, reader: FeatureReader, rows: NDArray[np.int64], pose: PoseOf | str
    ) -> FeatureReader:
        """Give the reader what it learns from some cases: typical motion and covariates."""
        if Further.COVARIATES in reader.further:
            learnt = covariate_columns([self.covariates[i] for i in rows])
            reader = replace(reader, covariates=learnt)
        if reader.typical is None or pose == PoseOf.FIXED:
            return reader
        sample = rows[:: -(-len(rows) // _MOST_TYPICAL)]
        motions = [self.rows[i].terms[_terms_key(reader)].terms for i in sample]
        return replace(reader, typical=mean_motion(motions, is_cycle=reader.is_cycle))

    def features(self, reader: FeatureReader) -> NDArray[np.float64]:
        """Features of all cases, (cases, readings, features) float64."""
        parts = []
        if reader.reads_motion:
            parts.append(self._motion(reader))
        for kind in reader.further:
            if kind == Further.COVARIATES:
                values = [reader.covariate_values(one) for one in self.covariates]
            else:
                key = FurtherKey(kind, reader.n_modes, reader.is_cycle, reader.walls)
                values = [row.further[key] for row in self.rows]
            parts.append(np.array(values)[:, None])
        n_readings = max(part.shape[1] for part in parts)
        return np.concatenate(
            [np.broadcast_to(p, (len(p), n_readings, p.shape[2])) for p in parts], axis=2
        )

    def _motion(self, reader: FeatureReader) -> NDArray[np.float64]:
        if reader.has_axis:
            return np.array([row.axis[reader.n_modes, reader.walls].values for row in self.rows])
        if reader.typical is not None:
            return self._modes(reader)
        # The same in all folds.
        key = (reader.n_modes, reader.is_cycle, reader.n_harmonics, reader.walls, reader.is_brief)
        if key not in self._cache:
            self._cache[key] = self._modes(reader)
        return self._cache[key]

    def _modes(self, reader: FeatureReader) -> NDArray[np.float64]:
        waves = reader.waves(first_modes(self.example, reader.n_modes))
        motions = [row.terms[_terms_key(reader)] for row in self.rows]
        return np.stack(reader.all_values(waves, motions))[:, None]

    def sizes(self, reader: FeatureReader) -> NDArray[np.float64]:
        """Size and smooth share of each motion, (cases, 2) float64."""
        if reader.has_axis:
            return np.array([row.axis[reader.n_modes, reader.walls][1:] for row in self.rows])
        motions = [row.terms[_terms_key(reader)] for row in self.rows]
        return np.array([(motion.size, motion.smooth_share) for motion in motions])

    def kinds(
        self, reader: FeatureReader, values: NDArray[np.float64], rows: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Give the kinds (`kind_of`) of some cases, (cases, readings, columns) float64."""
        motions = self.sizes(reader)[rows, :1]
        return kind_of(values, motions, powers_of(self.columns(reader)))

    def columns(self, reader: FeatureReader) -> tuple[Column, ...]:
        """Names of the features."""
        return reader.read(self.example).columns

    @cached_property
    def sights(self) -> Sights:
        """All cases as the domain sees them."""
        reader = self.domain_reader
        kinds = self.kinds(reader, self.features(reader), np.arange(len(self)))
        turns = theta_is_of_the_shape(self.example)
        signs = twin_signs(self.columns(reader), mirror_turns_theta=turns)
        return sights_of(kinds, self.allowed, of_kinds(signs), self.measures)


def _terms_key(reader: FeatureReader) -> TermsKey:
    return TermsKey(reader.n_modes, reader.is_cycle, reader.n_harmonics)


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
    labels: dict[str, str] = {}
    topologies: dict[str, list[tuple[str, str]]] = {}
    for number, case in zip(kept.numbers, kept.cases, strict=True):
        row = case.row
        known = labels.setdefault(row.sequence_id, row.label)
        if known != row.label:
            raise ParameterError(
                f"The recording {row.sequence_id[:12]} has two classes, {known!r} "
                f"and {row.label!r}.",
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


def class_counts(labels: Iterable[str]) -> dict[str, int]:
    """How often each label occurs, sorted by label."""
    return dict(sorted(Counter(labels).items()))


def _table(
    rows: list[CaseRow],
    classes: tuple[str, ...],
    example: ModalSignature,
    topologies: dict[str, list[tuple[str, str]]],
    options: TrainingOptions,
    notes: list[str],
) -> CaseTable:
    walls = tells_walls(rows, options)
    readers = feature_choices(rows, example, options, walls, n_topologies=len(topologies))
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
