"""From an articulated motion to numbers: a shape, affine maps of its parts, and what is left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.codec.modes.modes_section import OrthonormalModes
from modalmotion.codec.parts.parts import Parts
from modalmotion.codec.parts.segments import segmented
from modalmotion.codec.quantiser import Quantiser, fit_quantiser, is_countable, quantise
from modalmotion.codec.temporal import Temporal, basis_numbers, restore_basis
from modalmotion.codec.trial import PRICE, Trial, leading, rough_bits

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Articulated:
    """A motion, its parts, and the shape that they are maps of.

    Parameters
    ----------
    amplitudes : (frames, 3, modes) float64, quanta
    offsets : (frames, 3, vertices) float64, quanta
    modes : OrthonormalModes
    parts : Parts
    shape : (3, modes) float64, quanta
        Amplitudes of the shape.
    """

    amplitudes: Floats
    offsets: Floats
    modes: OrthonormalModes
    parts: Parts
    shape: Floats

    def attempt(self, step: float, price: float, alike: float | None) -> Trial | None:
        """Quantise at one step; None if it is finer than the numbers themselves.

        Parameters
        ----------
        step : float, quanta
        price : float, squared steps per bit
        alike : float, optional
            See `TimeBasis.project`.
        """
        exact = self.shape * np.sqrt(len(self.amplitudes))
        if not is_countable(exact, step):
            return None
        shape = quantise(exact, step, price)
        first = self._quantised(shape, fit_quantiser(exact, shape, step), price, alike, None)
        if first is None:
            return None
        # Again with one set of shifts for all numbers, and without what is not worth its bits.
        again = self._quantised(shape, first.shifted, price, alike, first.n_worth)
        return None if again is None else again.trial

    def _quantised(
        self,
        numbers: Ints,
        quantiser: Quantiser,
        price: float,
        alike: float | None,
        most: int | None,
    ) -> _Found | None:
        n_frames, step = len(self.amplitudes), quantiser.step
        constant = quantiser.restore(numbers) / np.sqrt(n_frames)
        shape = self.modes.synthesise(constant)
        functions = self.parts.functions(shape)
        turned = self.parts.gathered((self.offsets - shape).reshape(3 * n_frames, -1), functions)
        left = (self.amplitudes - constant).reshape(3 * n_frames, -1)

        exact_basis = basis_numbers(_components(turned, n_frames))
        if not is_countable(exact_basis, step):
            return None
        loud = np.abs(exact_basis).max(axis=1) > step / 2
        exact_basis = exact_basis[: int(np.count_nonzero(loud))][:most]
        basis = quantise(exact_basis, step, price)
        basis = basis[: leading(basis.any(axis=1))]
        time_basis = restore_basis(Temporal.PARTS, basis, n_frames, quantiser)
        B = time_basis.learned.reshape(3 * n_frames, -1)

        exact_maps, exact_rows = _fitted(B, turned, alike), _fitted(B, left, alike)
        if not (is_countable(exact_maps, step) and is_countable(exact_rows, step)):
            return None
        maps = quantise(exact_maps, step, price)
        mapped = quantiser.restore(maps) @ self.modes.analyse(self.parts.apart(functions))
        exact_rest = exact_rows - mapped
        rest = quantise(exact_rest, step, price)
        rows = mapped + quantiser.restore(rest)

        gain = (exact_rows**2 - (exact_rows - rows) ** 2).sum(axis=1) / step**2
        bits = rough_bits(basis) + rough_bits(maps) + rough_bits(rest)
        worth = np.cumsum(gain - price * bits)
        pairs = (
            (self.shape * np.sqrt(n_frames), numbers),
            (exact_basis[: len(basis)], basis),
            (exact_maps, maps),
            (exact_rest, rest),
        )
        trial = Trial(
            Temporal.PARTS,
            quantiser,
            basis,
            np.concatenate([numbers, rest]),
            float(((left - B @ rows) ** 2).sum()),
            self.parts,
            maps,
        )
        shifted = fit_quantiser(
            np.concatenate([exact.ravel() for exact, _ in pairs]),
            np.concatenate([rounded.ravel() for _, rounded in pairs]),
            step,
        )
        n_worth = int(np.argmax(worth)) + 1 if len(worth) and worth.max() > 0 else 0
        return _Found(trial, shifted, n_worth)


@dataclass(frozen=True, eq=False)
class _Found:
    """A trial, the quantiser that suits all its numbers, and how many components are worth it."""

    trial: Trial
    shifted: Quantiser
    n_worth: int


def find_parts(
    amplitudes: Floats, offsets: Floats, modes: OrthonormalModes, step: float
) -> Articulated | None:
    """Look for parts that move as one; None where there are none.

    Parameters
    ----------
    amplitudes : (frames, 3, modes) float64, quanta
    offsets : (frames, 3, vertices) float64, quanta
    modes : OrthonormalModes
    step : float, quanta
    """
    # The frame nearest to the mean: a shape that occurs, unlike the mean of what turns.
    far = ((offsets - offsets.mean(axis=0)) ** 2).sum(axis=(1, 2))
    reference = int(np.argmin(far))
    parts = segmented(offsets, reference, modes, step, PRICE)
    return (
        None
        if parts is None
        else Articulated(amplitudes, offsets, modes, parts, amplitudes[reference])
    )


def _components(turned: Floats, n_frames: int) -> Floats:
    """Principal components of what the parts do, (components, frames, 3), times their strength."""
    U, strengths, _ = scipy.linalg.svd(turned, full_matrices=False)
    return np.ascontiguousarray((U * strengths).T).reshape(-1, n_frames, 3)


def _fitted(B: Floats, motion: Floats, alike: float | None) -> Floats:
    """Find the combinations of components that leave the least error."""
    if not B.shape[1]:
        return np.zeros((0, motion.shape[1]))
    # Orthonormal up to their rounding: fitted, not projected.
    found, *_ = scipy.linalg.lstsq(B, motion, cond=alike, lapack_driver="gelsy")
    return np.asarray(found)
