"""First terms of a motion over time, of the modes as they are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.axis_parts import first
from modalmotion.classification.features.temporal import (
    N_SMOOTH,
    Turn,
    Turns,
    cosines,
    elapsed_share,
    followed_squares,
    harmonics,
    smooth_share_of,
)
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature

Array = NDArray[np.float64]

TERMS_PER_HARMONIC = 2
"""A course holds what a cycle of twice its length holds."""


class Shares(NamedTuple):
    """How much moves, and what share of it moves how.

    Parameters
    ----------
    total : float, percent
        Root of the sum of the squares of all terms.
    terms : (terms, modes, n) complex128
        Over the total; 0 where nothing moves.
    """

    total: float
    terms: NDArray[np.complex128]


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
        return math.sqrt(np.vdot(self.terms, self.terms).real)

    @property
    def shares(self) -> Shares:
        """Total, and the terms over it."""
        total = self.total
        return Shares(total, self.terms / total if total > 0 else self.terms)


class _Course(NamedTuple):
    """A motion about its mean, over the size of the surface, by its time.

    Parameters
    ----------
    share : (frames,) float64
        See `elapsed_share` and `cycle_share`.
    values : (frames, modes * n) float64
    squares : (2, modes) float64
        Sums over time, directions and the modes before: of all, and of what the first terms follow.
    """

    share: Array
    values: Array
    squares: Array


class Motion:
    """Motion of a signature, whose first modes are fitted by terms: all at once.

    Parameters
    ----------
    signature : ModalSignature
        Of at least two frames.
    turns : Turns, optional
        Of the signature.
    """

    def __init__(self, signature: ModalSignature, turns: Turns | None = None) -> None:
        self._signature = signature
        self._turns = turns or Turns(signature)
        self._size = surface_size(signature)
        self._courses: dict[int, _Course] = {}
        self._fits: dict[tuple[int, int], NDArray[np.complex128]] = {}
        self._terms: dict[tuple[bool, int, int], MotionTerms] = {}
        self._shares: dict[tuple[bool, int, int], Shares] = {}

    def shares(self, n_modes: int, n_harmonics: int, *, is_cycle: bool) -> Shares:
        """Total and shares of `terms`."""
        key = (is_cycle, n_modes, n_harmonics)
        if key not in self._shares:
            self._shares[key] = self.terms(n_modes, n_harmonics, is_cycle=is_cycle).shares
        return self._shares[key]

    def terms(self, n_modes: int, n_harmonics: int, *, is_cycle: bool) -> MotionTerms:
        """First terms of the first modes: harmonics of a cycle, cosines of a course.

        Parameters
        ----------
        n_modes : int
            0 for all.
        n_harmonics : int
            A course has `TERMS_PER_HARMONIC` for each.
        is_cycle : bool
        """
        key = (is_cycle, n_modes, n_harmonics)
        if key not in self._terms:
            self._terms[key] = self._first_terms(n_modes, n_harmonics, is_cycle=is_cycle)
        return self._terms[key]

    def _first_terms(self, n_modes: int, n_harmonics: int, *, is_cycle: bool) -> MotionTerms:
        n = n_modes or len(self._signature.modes)
        # How long a turn is the modes of a reading say by themselves.
        turn = self._turns.of_first(n) if is_cycle else None
        course, fit = self._course(turn), self._fit(turn, n_harmonics)
        total, followed = course.squares[:, n - 1].tolist()
        # Modes of springs tell the size each time they are counted, up to rounding.
        ratio = 1.0
        if self._signature.topology is None:
            ratio = self._size / surface_size(self._signature, n)
        n_frames = len(course.share)
        return MotionTerms(
            terms=fit[:, :n] * (100.0 * ratio),
            size=math.sqrt(total / n_frames) * ratio,
            smooth_share=smooth_share_of(n_frames, total, followed),
        )

    def _course(self, turn: Turn | None) -> _Course:
        """Give the course of a turn, or of the whole recording."""
        key = 0 if turn is None else len(turn.share)
        found = self._courses.get(key)
        if found is None:
            signature = self._signature if turn is None else turn.signature
            share = elapsed_share(signature) if turn is None else turn.share
            a = signature.body_amplitudes / self._size
            a -= np.add.reduce(a) / len(a)
            n, n_modes, n_directions = a.shape
            flat = a.reshape(n, -1)
            count = 2 * N_SMOOTH if turn is None else N_SMOOTH
            followed = followed_squares(share, flat, count, is_cycle=turn is not None)
            squares = np.array([np.einsum("ij,ij->j", flat, flat), followed])
            by_mode = np.add.reduce(squares.reshape(2, n_modes, n_directions), axis=2)
            found = _Course(share, flat, np.add.accumulate(by_mode, axis=1))
            self._courses[key] = found
        return found

    def _fit(self, turn: Turn | None, n_harmonics: int) -> NDArray[np.complex128]:
        key = (0 if turn is None else len(turn.share), n_harmonics)
        found = self._fits.get(key)
        if found is None:
            course = self._course(turn)
            if turn is None:
                n_terms = TERMS_PER_HARMONIC * n_harmonics
                fit = cosines(course.share, course.values, n_terms).astype(np.complex128)
            else:
                fit = harmonics(course.share, course.values, n_harmonics)
            found = self._fits[key] = fit.reshape(len(fit), *self._signature.amplitudes.shape[1:])
        return found


def surface_size(signature: ModalSignature, n_modes: int = 0) -> float:
    """Length that amplitudes are compared with, in the signature's unit; 1 where there is none.

    The geometric mean of the lengths along the coordinates. A mesh with spring modes has none:
    there it is the root mean square edge times a constant of the mesh, from the frequencies.

    Parameters
    ----------
    signature : ModalSignature
    n_modes : int
        First modes that frequencies are taken of; 0 for all.
    """
    modes, frequencies = signature.modes, signature.angular_frequencies
    if n_modes and modes.topology is None:
        modes, frequencies = first(modes, n_modes), frequencies[:n_modes]
    return modes.length_of(signature.lengths, frequencies, signature.parameters.wave_speed)
