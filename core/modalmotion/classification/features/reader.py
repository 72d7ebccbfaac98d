"""How a model reads signatures: which features, in which pose, from which start."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.alignment import align
from modalmotion.classification.features.axis import axis_features
from modalmotion.classification.features.columns import Column, MotionFeatures
from modalmotion.classification.features.invariants import (
    Waves,
    invariant_columns,
    invariants,
    waves_of,
)
from modalmotion.classification.features.offset_parts import offset_features
from modalmotion.classification.features.summary import summary, summary_columns
from modalmotion.classification.features.temporal import (
    cosines,
    elapsed_share,
    harmonics,
    one_turn,
    smooth_share,
)
from modalmotion.modes import Modes
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature, SignatureKind

# A course holds what a cycle of twice its length holds.
TERMS_PER_HARMONIC = 2

# Percent of the size: less motion than this counts as rest.
_LEAST_TOTAL = 1e-2


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
    """

    has_axis: bool
    is_cycle: bool
    n_harmonics: int
    walls: bool
    typical: NDArray[np.complex128] | None = None
    adds_modes: bool = False
    is_brief: bool = False

    @property
    def description(self) -> str:
        """The features, in words."""
        what = "a few numbers of the modes" if self.is_brief else "modes"
        if self.has_axis:
            what = "parts about the axis, and modes" if self.adds_modes else "parts about the axis"
        if self.typical is not None:
            how = "turned onto the typical motion" if self.typical.any() else "as they are"
            what += f" and their terms, {how}"
        return f"{what}; as a {'cycle' if self.is_cycle else 'course'}"

    def read(self, signature: ModalSignature) -> MotionFeatures:
        """Features of one sequence, one row for each way to read it.

        Parameters
        ----------
        signature : ModalSignature
            Of at least two frames.
        """
        if self.has_axis:
            n_sized = max(1, self.n_harmonics - 1)
            is_offset = signature.kind == SignatureKind.OFFSET
            features = offset_features if is_offset else axis_features
            parts = features(signature, self.n_harmonics, n_sized, walls=self.walls)
            if not self.adds_modes:
                return parts
            return parts.beside(self.of(signature, motion_of(signature, self)))
        return self.of(signature, motion_of(signature, self))

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
        )
        values = self.values(waves, motion)[None]
        return MotionFeatures(columns, values, motion.size, motion.smooth_share)

    def values(self, waves: Waves, motion: MotionTerms) -> NDArray[np.float64]:
        """Values of the features without their names, (features,) float64; see `of`."""
        total = float(np.linalg.norm(motion.terms))
        # How much moves is one feature; the others say what share of it moves how.
        terms = motion.terms / total if total > 0 else motion.terms
        describe = summary if self.is_brief else invariants
        values = [
            np.log([max(total, _LEAST_TOTAL)]),
            describe(terms, waves, is_cycle=self.is_cycle),
        ]
        if self.typical is not None:
            turned = terms
            if self.typical.any():
                turned = align(terms, self.typical, is_cycle=self.is_cycle)
            values.append(_flat(turned, is_cycle=self.is_cycle))
        return np.concatenate(values)

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


def motion_of(signature: ModalSignature, reader: FeatureReader) -> MotionTerms:
    """First terms of all amplitudes: harmonics of a cycle, cosines of a course."""
    if reader.is_cycle:
        signature = one_turn(signature)
    a = signature.body_amplitudes / surface_size(signature)
    a = a - a.mean(axis=0)
    n_frames = len(a)
    share, flat = elapsed_share(signature), a.reshape(n_frames, -1)
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
) -> tuple[Column, ...]:
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
