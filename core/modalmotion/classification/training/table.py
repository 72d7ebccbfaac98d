"""The table of a training set: features of labelled signatures, nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features import (
    Columns,
    FeatureReader,
    Further,
    covariate_columns,
    kind_of,
    mean_motion,
)
from modalmotion.classification.features.hand import theta_is_of_the_shape
from modalmotion.classification.features.patterns import learn_patterns
from modalmotion.classification.features.twins import of_kinds, twin_signs
from modalmotion.classification.model.domain import Sights, sights_of
from modalmotion.classification.model.model import Readable
from modalmotion.classification.options import PoseOf
from modalmotion.classification.training.case_row import CaseRow, FurtherKey, TermsKey
from modalmotion.classification.training.conditions import Conditions
from modalmotion.classification.training.left_out import LeftOut
from modalmotion.classification.training.own_folds import Fold
from modalmotion.signature.first_modes import first_modes
from modalmotion.signature.making import ModalSignature

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
        self, reader: FeatureReader, rows: NDArray[np.int64], pose: PoseOf | str, seed: int
    ) -> FeatureReader:
        """Give the reader what it learns from some cases: typical motion, patterns, covariates."""
        if Further.COVARIATES in reader.further:
            learnt = covariate_columns([self.covariates[i] for i in rows])
            reader = replace(reader, covariates=learnt)
        if reader.patterns is not None:
            shares = np.stack(
                [self.rows[i].terms[_terms_key(reader)].shares.terms.real for i in rows]
            )
            reader = replace(reader, patterns=learn_patterns(shares, self.y[rows], seed))
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
        if reader.typical is not None or reader.patterns is not None:
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
        return kind_of(values, motions, self.columns(reader).powers)

    def columns(self, reader: FeatureReader) -> Columns:
        """Names of the features."""
        return reader.columns(self.example)

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
