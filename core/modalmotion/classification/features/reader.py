"""How a model reads signatures: which features, in which pose, from which start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.alignment import align_all
from modalmotion.classification.features.axis import axis_features
from modalmotion.classification.features.centred import CentredMotions
from modalmotion.classification.features.columns import Column, MotionFeatures
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
from modalmotion.classification.features.offset_parts import offset_features
from modalmotion.classification.features.patterns import Patterns, pattern_names
from modalmotion.classification.features.summary import summary, summary_columns
from modalmotion.classification.features.temporal import (
    cosines,
    cycle_share,
    elapsed_share,
    harmonics,
    one_turn,
    smooth_share,
)
from modalmotion.modes import Modes
from modalmotion.representation import shown
from modalmotion.signature.first_modes import first_modes
from modalmotion.signature.making import ModalSignature, SignatureKind

# A course holds what a cycle of twice its length holds.
TERMS_PER_HARMONIC = 2

# Percent of the size: less motion than this counts as rest.
_LEAST_TOTAL = 1e-2


# Fields that the features of the motion depend on, beside what is learned.
_OF_MOTION: Final = (
    "has_axis",
    "is_cycle",
    "n_harmonics",
    "walls",
    "adds_modes",
    "is_brief",
    "n_modes",
)

_NOTHING: Final = MotionFeatures((), np.zeros((1, 0)), 0.0, 1.0)


class KnownFeatures:
    """What readers have read of the motion of one signature, for other readers of it.

    Attributes
    ----------
    features : dict
        Features of the motion, by all that they depend on.
    """

    def __init__(self) -> None:
        self.features: dict[tuple[object, ...], MotionFeatures] = {}
        self._motions: CentredMotions | None = None

    def motions_of(self, signature: ModalSignature) -> CentredMotions:
        """Centred motion of the signature, which is always the same one."""
        if self._motions is None:
            self._motions = CentredMotions(signature)
        return self._motions


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
            Of its motion: what other readers have read, and this one leaves for others.
        """
        known = KnownFeatures() if known is None else known
        features = _NOTHING
        if self.reads_motion:
            learned = (id(self.typical), id(self.patterns))
            key = (*(getattr(self, name) for name in _OF_MOTION), *learned)
            found = known.features.get(key)
            features = self._motion(signature, known) if found is None else found
            known.features[key] = features
        if not self.further:
            return features
        if self.n_modes:
            signature = first_modes(signature, self.n_modes)
        waves = self.waves(signature)
        size = surface_size(signature)
        values = [
            further_values(kind, signature, waves, size, is_cycle=self.is_cycle)
            for kind in self.further
            if kind != Further.COVARIATES
        ]
        if Further.COVARIATES in self.further:
            values.append(self.covariate_values(signature.facts.covariates))
        further = MotionFeatures(
            further_columns(self.further, waves, self.covariates, is_cycle=self.is_cycle),
            np.concatenate(values)[None],
            0.0,
            1.0,
        )
        return features.beside(further)

    def covariate_values(self, covariates: Mapping[str, float | str]) -> NDArray[np.float64]:
        """Numbers of covariates, (features,) float64."""
        return np.array([v for column in self.covariates for v in column.values(covariates)])

    def _motion(self, signature: ModalSignature, known: KnownFeatures) -> MotionFeatures:
        if not self.has_axis:
            return self._of_modes(signature)
        is_offset = signature.kind == SignatureKind.OFFSET
        parts = (offset_features if is_offset else axis_features)(
            signature,
            self.n_harmonics,
            max(1, self.n_harmonics - 1),
            walls=self.walls,
            n_modes=self.n_modes,
            motions=known.motions_of(signature),
        )
        return parts.beside(self._of_modes(signature)) if self.adds_modes else parts

    def _of_modes(self, signature: ModalSignature) -> MotionFeatures:
        few = first_modes(signature, self.n_modes) if self.n_modes else signature
        return self.of(few, motion_of(few, self))

    def of(self, signature: ModalSignature, motion: MotionTerms) -> MotionFeatures:
        """Features of a motion whose terms are known, for surfaces of any topology."""
        waves = self.waves(signature)
        columns = _columns(
            signature.modes,
            waves,
            motion.terms.shape,
            is_cycle=self.is_cycle,
            is_brief=self.is_brief,
            has_terms=self.typical is not None,
            n_patterns=None if self.patterns is None else len(self.patterns),
        )
        values = self.values(waves, motion)[None]
        return MotionFeatures(columns, values, motion.size, motion.smooth_share)

    def values(self, waves: Waves, motion: MotionTerms) -> NDArray[np.float64]:
        """Values of the features without their names, (features,) float64; see `of`."""
        return self.all_values(waves, [motion])[0]

    def all_values(self, waves: Waves, motions: Sequence[MotionTerms]) -> list[NDArray[np.float64]]:
        """Values of the features of several motions, each (features,) float64."""
        totals = [motion.total for motion in motions]
        # How much moves is one feature; the others say what share of it moves how.
        shares = np.stack([motion.shares for motion in motions])
        if self.patterns is not None:
            sizes = np.log(np.maximum(totals, _LEAST_TOTAL))
            found = self.patterns.features(shares.real)
            return list(np.concatenate([sizes[:, None], found], axis=1))
        describe = summary if self.is_brief else invariants
        values = [
            [np.log([max(total, _LEAST_TOTAL)]), describe(terms, waves, is_cycle=self.is_cycle)]
            for total, terms in zip(totals, shares, strict=True)
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
        topology = signature.topology
        is_free = topology is not None and bool(topology.closed_axes) and not self.walls
        return waves_of(signature.modes, theta_is_free=is_free)


@shown()
@dataclass(frozen=True, eq=False)
class MotionTerms:
    """First terms of a motion.

    Parameters
    ----------
    terms : (terms, modes, n) complex128
        In percent of the surface's size.
    size : float
        RMS of the motion about its mean over time, as a share of the surface's size.
    smooth_share : float
        See `smooth_share`.
    """

    terms: NDArray[np.complex128]
    size: float
    smooth_share: float

    @property
    def total(self) -> float:
        """Root of the sum of all squares, percent."""
        return float(np.linalg.norm(self.terms))

    @property
    def shares(self) -> NDArray[np.complex128]:
        """Terms over their total, (terms, modes, n); 0 where nothing moves."""
        total = self.total
        return self.terms / total if total > 0 else self.terms


def motion_of(signature: ModalSignature, reader: FeatureReader) -> MotionTerms:
    """First terms of all amplitudes: harmonics of a cycle, cosines of a course."""
    if reader.is_cycle:
        signature = one_turn(signature)
    a = signature.body_amplitudes / surface_size(signature)
    a = a - a.mean(axis=0)
    n_frames = len(a)
    share = cycle_share(signature) if reader.is_cycle else elapsed_share(signature)
    flat = a.reshape(n_frames, -1)
    if reader.is_cycle:
        terms = harmonics(share, flat, reader.n_harmonics)
    else:
        n_terms = TERMS_PER_HARMONIC * reader.n_harmonics
        terms = cosines(share, flat, n_terms).astype(np.complex128)
    return MotionTerms(
        terms=100.0 * terms.reshape(-1, *a.shape[1:]),
        size=float(np.sqrt((flat**2).sum(axis=1).mean())),
        smooth_share=smooth_share(share, flat, is_cycle=reader.is_cycle),
    )


def surface_size(signature: ModalSignature) -> float:
    """Length that amplitudes are compared with, in the signature's unit; 1 where there is none.

    The geometric mean of the lengths along the coordinates. A mesh with spring modes has none:
    there it is the root mean square edge times a constant of the mesh, from the frequencies.
    """
    return signature.modes.length_of(
        signature.lengths, signature.angular_frequencies, signature.parameters.wave_speed
    )


def _flat(terms: NDArray[np.complex128], *, is_cycle: bool) -> NDArray[np.float64]:
    return np.concatenate([terms.real, terms.imag]).ravel() if is_cycle else terms.real.ravel()


@lru_cache(maxsize=32)
def _columns(
    modes: Modes,
    waves: Waves,
    shape: tuple[int, ...],
    *,
    is_cycle: bool,
    is_brief: bool,
    has_terms: bool,
    n_patterns: int | None,
) -> tuple[Column, ...]:
    if n_patterns is not None:
        names = ("motion", *pattern_names(n_patterns))
        return tuple(Column(name, waves.all_modes, 0.0) for name in names)
    name = summary_columns if is_brief else invariant_columns
    n_terms, _, n_directions = shape
    described = name(waves, n_terms, n_directions, is_cycle=is_cycle)
    columns = [Column("motion", waves.all_modes), *described]
    if has_terms:
        columns += _term_columns(modes, n_terms, n_directions, is_cycle=is_cycle)
    # Shares do not grow with the motion.
    return tuple(replace(column, power=0.0) for column in columns)


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
