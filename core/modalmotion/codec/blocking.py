"""From motion to a block: projecting, choosing components, quantising."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.block import Block
from modalmotion.codec.quantiser import (
    Quantiser,
    fit_quantiser,
    is_countable,
    last_used,
    quantise,
)
from modalmotion.codec.temporal import (
    CLOSED_FORM,
    Temporal,
    basis_numbers,
    closed_form_basis,
    learned_components,
    restore_basis,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PRICE: Final = 0.13
"""Squared steps that a bit is worth: the slope of distortion over rate of a fine quantiser."""


@dataclass(eq=False)
class ModalBlock:
    """Modal coefficients of some frames, and values derived from them.

    Parameters
    ----------
    amplitudes : (frames, 3, modes) float64, quanta
        About the origin; the modes are orthonormal.
    """

    amplitudes: Floats
    _projected: dict[Temporal, Floats] = field(default_factory=dict)
    _components: dict[Temporal, Floats] = field(default_factory=dict)

    def projected(self, kind: Temporal) -> Floats:
        """Coefficients of a basis in closed form, (3 x components, modes), slow ones first."""
        if kind not in self._projected:
            basis = closed_form_basis(kind, len(self.amplitudes))
            self._projected[kind] = basis.project(self.amplitudes)
        return self._projected[kind]

    def components(self, kind: Temporal) -> Floats:
        """Numbers of the learned components, unrounded, (components, frames x directions)."""
        if kind not in self._components:
            self._components[kind] = basis_numbers(learned_components(self.amplitudes, kind))
        return self._components[kind]


@dataclass(frozen=True, eq=False)
class Trial:
    """A block at some step, and the error it makes.

    Parameters
    ----------
    kind : Temporal
    quantiser : Quantiser
    basis : (components, frames x directions) int64
    coefficients : (rows, modes) int64
    squared_error : float, quanta squared
        Summed over frames and vertices.
    """

    kind: Temporal
    quantiser: Quantiser
    basis: Ints
    coefficients: Ints
    squared_error: float

    @property
    def largest(self) -> int:
        """Largest magnitude of all numbers."""
        parts = (self.basis, self.coefficients)
        return max(max(-int(n.min(initial=0)), int(n.max(initial=0))) for n in parts)

    def block(
        self,
        n_frames: int,
        exponent: int,
        origin: Ints,
        width: int = 0,
    ) -> Block:
        """Make the block, without modes that no coefficient uses."""
        n_modes = max(1, last_used(self.coefficients.any(axis=0)))
        return Block(
            self.kind,
            n_frames,
            self.quantiser,
            self.basis,
            self.coefficients[:, :n_modes],
            exponent,
            origin,
            width,
        )


def attempt(
    motion: ModalBlock,
    kind: Temporal,
    step: float,
    price: float = PRICE,
    alike: float | None = None,
) -> Trial | None:
    """Quantise some frames at one step.

    Parameters
    ----------
    motion : ModalBlock
    kind : Temporal
    step : float, quanta
    price : float, squared steps per bit
    alike : float, optional
        See `TimeBasis.project`.

    Returns
    -------
    Trial or None
        None if the step is finer than the numbers themselves.
    """
    # As the stream holds it.
    step = float(np.float32(step))
    if kind in CLOSED_FORM:
        exact = motion.projected(kind)
        if not is_countable(exact, step):
            return None
        numbers = quantise(exact, step, price)
        n_rows = 3 * max(1, -(-last_used(numbers.any(axis=1)) // 3))
        quantiser = fit_quantiser(exact[:n_rows], numbers[:n_rows], step)
        error = ((exact[:n_rows] - quantiser.restore(numbers[:n_rows])) ** 2).sum()
        error += (exact[n_rows:] ** 2).sum()
        empty = np.zeros((0, 0), dtype=np.int64)
        return Trial(kind, quantiser, empty, numbers[:n_rows], float(error))
    return _attempt_learned(motion, kind, step, price, alike)


def _attempt_learned(
    motion: ModalBlock, kind: Temporal, step: float, price: float, alike: float | None
) -> Trial | None:
    n_frames = len(motion.amplitudes)
    each = kind.rows_each
    exact_basis = motion.components(kind)
    if not is_countable(exact_basis, step):
        return None
    exact_basis = exact_basis[: int(np.count_nonzero(np.abs(exact_basis).max(axis=1) > step / 2))]
    basis = quantise(exact_basis, step, price)
    basis = basis[: _leading(basis.any(axis=1))]
    for last in (False, True):
        exact_basis = exact_basis[: len(basis)]
        quantiser = fit_quantiser(exact_basis, basis, step)
        time_basis = restore_basis(kind, basis, n_frames, quantiser)
        exact = time_basis.project(motion.amplitudes, alike)
        if not is_countable(exact, step):
            return None
        numbers = quantise(exact, step, price)
        if last or not len(basis):
            break
        restored = Quantiser(step, (0, 0, 0)).restore(numbers[3:])
        gain = (exact[3:] ** 2 - (exact[3:] - restored) ** 2).sum(axis=1).reshape(-1, each)
        bits = _rough_bits(numbers[3:]).reshape(-1, each).sum(axis=1) + _rough_bits(basis)
        worth = np.cumsum(gain.sum(axis=1) / step**2 - price * bits)
        n_worth = int(np.argmax(worth)) + 1 if worth.max() > 0 else 0
        if n_worth == len(basis):
            break
        basis = basis[:n_worth]
    together = fit_quantiser(
        np.concatenate([exact_basis.ravel(), exact.ravel()]),
        np.concatenate([basis.ravel(), numbers.ravel()]),
        step,
    )
    if together.shifts != quantiser.shifts:
        time_basis = restore_basis(kind, basis, n_frames, together)
    rows = together.restore(numbers)
    error = ((motion.amplitudes - time_basis.superpose(rows)) ** 2).sum()
    return Trial(kind, together, basis, numbers, float(error))


def _leading(used: Any) -> int:
    """Count the rows before the first that is all zero."""
    return len(used) if used.all() else int(np.argmin(used))


def _rough_bits(numbers: Ints) -> Floats:
    """Bits of each row, roughly: where its values are, their signs and magnitudes."""
    n = numbers.shape[1]
    occupied = np.count_nonzero(numbers, axis=1)
    share = np.maximum(occupied, 1) / n
    where = occupied * (np.log2(1.0 / share) + 1.4 * (1.0 - share))
    bits: Floats = where + occupied + 1.6 * np.log2(np.maximum(np.abs(numbers), 1)).sum(axis=1)
    return bits
