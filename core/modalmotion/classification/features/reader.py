"""How a model reads signatures: which features, in which pose, from which start."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.alignment import align_all
from modalmotion.classification.features.axis import axis_columns, axis_features
from modalmotion.classification.features.axis_parts import first
from modalmotion.classification.features.columns import (
    Column,
    Columns,
    MotionFeatures,
    MotionValues,
)
from modalmotion.classification.features.further import (
    CovariateColumn,
    Further,
    further_columns,
    further_values,
)
from modalmotion.classification.features.invariants import (
    Waves,
    invariant_columns,
    invariants,
    waves_of,
)
from modalmotion.classification.features.known import KnownFeatures
from modalmotion.classification.features.motion_terms import (
    TERMS_PER_HARMONIC,
    Motion,
    MotionTerms,
)
from modalmotion.classification.features.offset_parts import offset_columns, offset_features
from modalmotion.classification.features.patterns import Patterns, pattern_names
from modalmotion.classification.features.summary import summary, summary_columns
from modalmotion.modes import Modes
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature, SignatureKind

# Percent of the size: less motion than this counts as rest.
_LEAST_TOTAL = 1e-2


class PartKey(NamedTuple):
    """What features of one part depend on, beside the signature.

    Parameters
    ----------
    kind : Further or None
        None for the motion.
    reads : tuple
        How it is read.
    """

    kind: Further | None
    reads: tuple[object, ...]


_NOTHING: Final = MotionValues(np.zeros((1, 0)), 0.0, 1.0)


@shown()
@dataclass(frozen=True, eq=False)
class FeatureReader:
    """Choice of features.

    Parameters
    ----------
    has_axis : bool
        Read parts about an axis (`axis_features`) and not modes as they are.
    is_cycle : bool
        Whether a recording is one turn of a cycle and may start anywhere in it.
    n_harmonics : int
        Of parts with a sign and of modes; one less, but at least one, of parts without.
    walls : bool
        Whether the zero of theta is known, so that walls are told apart.
    typical : (terms, modes, n) complex128 or None
        Motion onto which each one is turned, and which it is started like, before its terms
        are features themselves; None to use invariants alone. All zero where recordings share
        their coordinates and are not turned.
    adds_modes : bool
        About an axis: whether modes are read as they are beside the parts.
    is_brief : bool
        Whether modes are summed up in a few numbers (`summary`).
    n_modes : int
        First modes that are read; 0 for all.
    reads_motion : bool
        Whether the motion is read at all, and not only what is beside it.
    further : tuple of Further
        Other features, beside those of the motion.
    covariates : tuple of CovariateColumn
        How covariates become numbers, where `further` names them.
    patterns : Patterns or None
        Pieces of motions that are looked for in courses, in the place of what modes do as a whole;
        none of them before they are learned.
    """

    has_axis: bool
    is_cycle: bool
    n_harmonics: int
    walls: bool
    typical: NDArray[np.complex128] | None = None
    adds_modes: bool = False
    is_brief: bool = False
    n_modes: int = 0
    reads_motion: bool = True
    further: tuple[Further, ...] = ()
    covariates: tuple[CovariateColumn, ...] = ()
    patterns: Patterns | None = None

    @property
    def description(self) -> str:
        """The features, in words."""
        what = "a few numbers of the modes" if self.is_brief else "modes"
        if self.has_axis:
            what = "parts about the axis, and modes" if self.adds_modes else "parts about the axis"
        if self.typical is not None:
            how = "turned onto the typical motion" if self.typical.any() else "as they are"
            what += f" and their terms, {how}"
        if self.patterns is not None:
            what = "pieces of motions, found in the modes"
        beside = ", ".join(self.further)
        if not self.reads_motion:
            return beside
        count = f" of {self.n_modes} modes" if self.n_modes else ""
        how = f"{what}{count}; {self.n_harmonics} harmonics of a cycle"
        if not self.is_cycle:
            how = f"{what}{count}; {TERMS_PER_HARMONIC * self.n_harmonics} terms of a course"
        return f"{how}; {beside}" if beside else how

    def read(
        self,
        signature: ModalSignature,
        known: KnownFeatures | None = None,
    ) -> MotionFeatures:
        """Features of one sequence, one row for each way to read it.

        Parameters
        ----------
        signature : ModalSignature
            Of at least two frames.
        known : KnownFeatures, optional
            Of it: what other readers have read, and this one leaves for others.
        """
        known = KnownFeatures() if known is None else known
        motion = self.motion(signature, known)
        parts = [self.part(key, signature, known) for key in self.part_keys]
        values = side_by_side(parts)
        columns = self.columns(signature)
        return MotionFeatures(columns, values, motion.motion, motion.smooth_share)

    def columns(self, signature: ModalSignature) -> Columns:
        """Names of the features."""
        parts: list[tuple[Column, ...]] = []
        if self.reads_motion and self.has_axis:
            name = offset_columns if signature.kind == SignatureKind.OFFSET else axis_columns
            modes = self._modes(signature)
            parts.append(name(modes, self.n_harmonics, self._n_sized, walls=self.walls))
        if self.reads_motion and (self.adds_modes or not self.has_axis):
            n_terms = self.n_harmonics * (1 if self.is_cycle else TERMS_PER_HARMONIC)
            own = _columns(
                self._modes(signature),
                self.waves(signature),
                (n_terms, signature.amplitudes.shape[2]),
                is_cycle=self.is_cycle,
                is_brief=self.is_brief,
                has_terms=self.typical is not None,
                n_patterns=None if self.patterns is None else len(self.patterns),
            )
            parts.append(own)
        if self.further:
            waves = self.waves(signature)
            beside = further_columns(self.further, waves, self.covariates, is_cycle=self.is_cycle)
            parts.append(beside)
        if len(parts) == 1 and isinstance(parts[0], Columns):
            return parts[0]
        return Columns(column for part in parts for column in part)

    def motion(self, signature: ModalSignature, known: KnownFeatures) -> MotionValues:
        """Features of the motion, without their names; none where it is not read."""
        if not self.reads_motion:
            return _NOTHING
        found = known.features.get(self.motion_key)
        if found is None:
            found = known.features[self.motion_key] = self._motion(signature, known)
        return found

    def part(
        self, key: PartKey, signature: ModalSignature, known: KnownFeatures
    ) -> NDArray[np.float64]:
        """Features of one part, without their names, (readings, features) float64."""
        if key.kind is None:
            return self.motion(signature, known).values
        found = known.further.get(key)
        if found is None:
            found = known.further[key] = self._further(key.kind, signature, known)[None]
        return found

    @cached_property
    def part_keys(self) -> tuple[PartKey, ...]:
        """The motion and what is beside it, by all that each depends on beside the signature."""
        motion = (PartKey(None, self.motion_key),) if self.reads_motion else ()
        of_modes = (self.n_modes, self.is_cycle, self.walls)
        return motion + tuple(
            PartKey(kind, (*of_modes, self.covariates if kind == Further.COVARIATES else ()))
            for kind in self.further
        )

    @cached_property
    def terms_key(self) -> tuple[object, ...]:
        """What features of modes depend on, beside the signature and what was learned."""
        return self.n_modes, self.is_cycle, self.n_harmonics, self.walls, self.is_brief

    @cached_property
    def motion_key(self) -> tuple[object, ...]:
        """What features of the motion depend on, beside the signature."""
        learned = () if self.patterns is None else self.patterns.arrays
        if self.typical is not None:
            learned = (*learned, self.typical.real, self.typical.imag)
        # By content: readers that were stored have arrays of their own.
        digests = tuple(hashlib.sha256(array.tobytes()).digest() for array in learned)
        return (self.terms_key, self.has_axis, self.adds_modes, self.typical is None, digests)

    def covariate_values(self, covariates: Mapping[str, float | str]) -> NDArray[np.float64]:
        """Numbers of covariates, (features,) float64."""
        return np.array([v for column in self.covariates for v in column.values(covariates)])

    def _further(
        self, kind: Further, signature: ModalSignature, known: KnownFeatures
    ) -> NDArray[np.float64]:
        if kind == Further.COVARIATES:
            return self.covariate_values(signature.facts.covariates)
        few = known.first_modes(signature, self.n_modes)
        waves = turn = None
        if kind == Further.REST_SHAPE:
            waves = self.waves(few)
        elif kind == Further.VOLUME_CURVE and self.is_cycle:
            turn = known.turns(signature).of_first(self.n_modes)
        return further_values(kind, few, waves, is_cycle=self.is_cycle, turn=turn)

    def _motion(self, signature: ModalSignature, known: KnownFeatures) -> MotionValues:
        if not self.has_axis:
            return self._of_modes(signature, known)
        is_offset = signature.kind == SignatureKind.OFFSET
        parts = (offset_features if is_offset else axis_features)(
            signature,
            self.n_harmonics,
            self._n_sized,
            walls=self.walls,
            n_modes=self.n_modes,
            motions=known.centred(signature),
        )
        values = parts.values
        if self.adds_modes:
            values = side_by_side([values, self._of_modes(signature, known).values])
        return MotionValues(values, parts.motion, parts.smooth_share)

    @property
    def _n_sized(self) -> int:
        """Harmonics of parts without a sign."""
        return max(1, self.n_harmonics - 1)

    def _of_modes(self, signature: ModalSignature, known: KnownFeatures) -> MotionValues:
        fitted, of = known.motion(signature), (self.n_modes, self.n_harmonics)
        motion = fitted.terms(*of, is_cycle=self.is_cycle)
        shares, waves = fitted.shares(*of, is_cycle=self.is_cycle), self.waves(signature)
        described = None
        if self.patterns is None:
            described = known.described.get(self.terms_key)
            if described is None:
                described = self._described(waves, shares.terms)
                known.described[self.terms_key] = described
        values = self._values(waves, [shares.total], shares.terms[None], described)
        return MotionValues(values[0][None], motion.size, motion.smooth_share)

    def values(self, waves: Waves, motion: MotionTerms) -> NDArray[np.float64]:
        """Features of a motion whose terms are known, without names, (features,) float64.

        For surfaces of any topology.
        """
        return self.all_values(waves, [motion])[0]

    def all_values(self, waves: Waves, motions: Sequence[MotionTerms]) -> list[NDArray[np.float64]]:
        """Values of the features of several motions, each (features,) float64."""
        totals, shares = zip(*(motion.shares for motion in motions), strict=True)
        return self._values(waves, totals, np.array(shares))

    def _values(
        self,
        waves: Waves,
        totals: Sequence[float],
        shares: NDArray[np.complex128],
        described: NDArray[np.float64] | None = None,
    ) -> list[NDArray[np.float64]]:
        """Values of the features of motions; of one alone what is known of it may be given."""
        # How much moves is one feature; the others say what share of it moves how.
        sizes = np.array([[math.log(max(total, _LEAST_TOTAL))] for total in totals])
        if self.patterns is not None:
            found = self.patterns.features(shares.real)
            return list(np.concatenate([sizes, found], axis=1))
        values = [
            [size, self._described(waves, terms) if described is None else described]
            for size, terms in zip(sizes, shares, strict=True)
        ]
        if self.typical is not None:
            turned = shares
            if self.typical.any():
                turned = align_all(shares, self.typical, is_cycle=self.is_cycle)
            for parts, terms in zip(values, turned, strict=True):
                parts.append(_flat(terms, is_cycle=self.is_cycle))
        return [np.concatenate(parts) for parts in values]

    def waves(self, signature: ModalSignature) -> Waves:
        """Modes that the reader takes together."""
        return waves_of(self._modes(signature), theta_is_free=not self.walls)

    def _modes(self, signature: ModalSignature) -> Modes:
        return first(signature.modes, self.n_modes) if self.n_modes else signature.modes

    def _described(self, waves: Waves, shares: NDArray[np.complex128]) -> NDArray[np.float64]:
        describe = summary if self.is_brief else invariants
        return describe(shares, waves, is_cycle=self.is_cycle)


def motion_of(signature: ModalSignature, reader: FeatureReader) -> MotionTerms:
    """First terms of all amplitudes: harmonics of a cycle, cosines of a course."""
    return Motion(signature).terms(0, reader.n_harmonics, is_cycle=reader.is_cycle)


def side_by_side(parts: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Features one after another, (readings, features); what has one reading has it in all."""
    if len(parts) == 1:
        return parts[0]
    first = np.concatenate([part[0] for part in parts])
    values = np.empty((max(map(len, parts)), len(first)))
    values[:] = first
    place = 0
    for part in parts:
        n, width = part.shape
        if n > 1:
            values[:, place : place + width] = part
        place += width
    return values


def _flat(terms: NDArray[np.complex128], *, is_cycle: bool) -> NDArray[np.float64]:
    return np.concatenate([terms.real, terms.imag]).ravel() if is_cycle else terms.real.ravel()


@lru_cache(maxsize=64)
def _columns(
    modes: Modes,
    waves: Waves,
    shape: tuple[int, int],
    *,
    is_cycle: bool,
    is_brief: bool,
    has_terms: bool,
    n_patterns: int | None,
) -> Columns:
    if n_patterns is not None:
        names = ("motion", *pattern_names(n_patterns))
        return Columns(Column(name, waves.all_modes, 0.0) for name in names)
    name = summary_columns if is_brief else invariant_columns
    n_terms, n_directions = shape
    described = name(waves, n_terms, n_directions, is_cycle=is_cycle)
    columns = [Column("motion", waves.all_modes), *described]
    if has_terms:
        columns += _term_columns(modes, n_terms, n_directions, is_cycle=is_cycle)
    # Shares do not grow with the motion.
    return Columns(replace(column, power=0.0) for column in columns)


def _term_columns(modes: Modes, n_terms: int, n_directions: int, *, is_cycle: bool) -> list[Column]:
    parts = [f"cos {h + 1}" for h in range(n_terms)]
    if is_cycle:
        parts += [f"sin {h + 1}" for h in range(n_terms)]
    else:
        parts = [f"term {h + 1}" for h in range(n_terms)]
    return [
        Column(f"{label} direction {direction} {part}", (k,))
        for part in parts
        for k, label in enumerate(modes.labels)
        for direction in range(1, n_directions + 1)
    ]
