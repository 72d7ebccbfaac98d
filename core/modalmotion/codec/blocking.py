"""From motion to a block: projecting, choosing components, quantising."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.modes.modes_section import OrthonormalModes
from modalmotion.codec.parts.articulated import Articulated, find_parts
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
from modalmotion.codec.trial import PRICE, Trial, leading, rough_bits

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(eq=False)
class ModalBlock:
    """Modal coefficients of some frames, and values derived from them.

    Parameters
    ----------
    amplitudes : (frames, 3, modes) float64, quanta
        About the origin; the modes are orthonormal.
    offsets : (frames, 3, vertices) float64, quanta, optional
        What they are the coefficients of.
    modes : OrthonormalModes, optional
        Together with the offsets: to look for parts that move as one.
    """

    amplitudes: Floats
    offsets: Floats | None = None
    modes: OrthonormalModes | None = None
    _projected: dict[Temporal, Floats] = field(default_factory=dict)
    _articulated: list[Articulated | None] = field(default_factory=list)

    def projected(self, kind: Temporal) -> Floats:
        """Coefficients of a basis in closed form, (3 x components, modes), slow ones first."""
        if kind not in self._projected:
            basis = closed_form_basis(kind, len(self.amplitudes))
            self._projected[kind] = basis.project(self.amplitudes)
        return self._projected[kind]

    @cached_property
    def components(self) -> Floats:
        """Numbers of the learned components, unrounded, (components, frames x 3)."""
        return basis_numbers(learned_components(self.amplitudes))

    def articulated(self, step: float) -> Articulated | None:
        """Parts that move as one, found at the first step asked for; None where there are none."""
        if not self._articulated:
            found = None
            if self.offsets is not None and self.modes is not None:
                found = find_parts(self.amplitudes, self.offsets, self.modes, step)
            self._articulated.append(found)
        return self._articulated[0]


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
    if kind == Temporal.PARTS:
        parts = motion.articulated(step)
        return None if parts is None else parts.attempt(step, price, alike)
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
    return _attempt_trajectories(motion, step, price, alike)


def _attempt_trajectories(
    motion: ModalBlock, step: float, price: float, alike: float | None
) -> Trial | None:
    kind, n_frames, exact_basis = Temporal.TRAJECTORY, len(motion.amplitudes), motion.components
    if not is_countable(exact_basis, step):
        return None
    exact_basis = exact_basis[: int(np.count_nonzero(np.abs(exact_basis).max(axis=1) > step / 2))]
    basis = quantise(exact_basis, step, price)
    basis = basis[: leading(basis.any(axis=1))]
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
        gain = (exact[3:] ** 2 - (exact[3:] - restored) ** 2).sum(axis=1)
        bits = rough_bits(numbers[3:]) + rough_bits(basis)
        worth = np.cumsum(gain / step**2 - price * bits)
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
