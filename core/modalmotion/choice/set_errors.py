"""Errors of nested sets of modes, of the requested kind."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.choice.energies import Energies, energies_of
from modalmotion.choice.fitter import Fitter
from modalmotion.choice.harmonics import Harmonics, harmonics_of, require_harmonics
from modalmotion.choice.largest_errors import largest_errors
from modalmotion.choice.nested_sets import Ladder
from modalmotion.choice.parameters import ErrorKind
from modalmotion.choice.plain_energies import plain_energies_of
from modalmotion.fit.fit import Fit

# Errors of nested sets are known to this share, and to this share of the motion.
_ROUNDING: Final = 1e-9
_ROUNDING_OF_MOTION: Final = 1e-12


@dataclass(frozen=True, eq=False)
class SetErrors:
    """Errors of the sets of one ladder, of the requested kind.

    Parameters
    ----------
    fitter : Fitter
    ladder : Ladder
    energies : Energies
        Plain ones for the RMS over all vertices, by weight for any other kind.
    """

    fitter: Fitter
    ladder: Ladder
    energies: Energies

    @staticmethod
    def on(fitter: Fitter, ladder: Ladder, fit: Fit) -> SetErrors:
        """Measure the sets of a ladder whose largest is fitted."""
        is_plain = fitter.parameters.tolerance_of == ErrorKind.RMS
        if is_plain:
            return SetErrors(fitter, ladder, plain_energies_of(fitter, ladder.basis, fit))
        return SetErrors(fitter, ladder, energies_of(ladder.basis, fit))

    def slack(self, limit: float) -> float:
        """Bound the rounding of errors computed from energies."""
        return _ROUNDING * limit + _ROUNDING_OF_MOTION * self.energies.scale

    def bound(self, counts: NDArray[np.int64]) -> NDArray[np.float64]:
        """RMS errors: the requested ones, or a lower bound of the largest."""
        if self.fitter.parameters.harmonics is not None:
            return self._joint(counts)
        if self.fitter.parameters.tolerance_of == ErrorKind.MAX:
            return self.energies.worst_frame_rms(counts)
        return self.energies.rms(counts)

    def of(self, counts: NDArray[np.int64]) -> NDArray[np.float64]:
        """Errors of sets that increase in number."""
        if self.fitter.parameters.tolerance_of != ErrorKind.MAX:
            return self.bound(counts)
        limited = self.energies
        if self.fitter.parameters.harmonics is not None:
            functions = self._functions
            paths = functions.limited(limited.coefficients, self.fitter.parameters.harmonics)
            limited = replace(limited, coefficients=paths)
        return largest_errors(self.fitter, self.ladder, limited, counts)

    def best(self, known: dict[int, float]) -> tuple[float, int]:
        """Smallest error of all sets, and its number of modes."""
        counts = self.ladder.counts
        bounds = self.bound(counts)
        first = counts[[int(np.argmin(bounds))]]
        tried = {**known, int(first[0]): float(self.of(first)[0])}
        # No set is better than its bound: those that may be are measured together.
        others = counts[bounds < min(tried.values())]
        if self.fitter.parameters.tolerance_of == ErrorKind.MAX and len(others):
            tried.update(zip(others.tolist(), self.of(others).tolist(), strict=True))
        return min((error, count) for count, error in tried.items())

    @property
    def _functions(self) -> Harmonics:
        return harmonics_of(self.fitter.sequence.n_frames, self.fitter.sequence.times)

    def _joint(self, counts: NDArray[np.int64]) -> NDArray[np.float64]:
        functions = self._functions
        harmonics = self.fitter.parameters.harmonics or 0
        require_harmonics(harmonics, functions)
        return self.energies.joint_rms(counts, functions)[:, harmonics]
