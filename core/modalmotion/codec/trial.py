"""What quantising some frames at one step gives."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.block import Block
from modalmotion.codec.parts.parts import Parts
from modalmotion.codec.quantiser import Quantiser, last_used
from modalmotion.codec.temporal import Temporal

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PRICE: Final = 0.13
"""Squared steps that a bit is worth: the slope of distortion over rate of a fine quantiser."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A block at some step, and the error it makes.

    Parameters
    ----------
    kind : Temporal
    quantiser : Quantiser
    basis : (components, frames x 3) int64
    coefficients : (rows, modes) int64
    squared_error : float, quanta squared
        Summed over frames and vertices.
    parts : Parts, optional
    maps : (components, 4 x parts) int64
    """

    kind: Temporal
    quantiser: Quantiser
    basis: Ints
    coefficients: Ints
    squared_error: float
    parts: Parts | None = None
    maps: Ints = field(default_factory=lambda: np.zeros((0, 0), dtype=np.int64))

    @property
    def largest(self) -> int:
        """Largest magnitude of all numbers."""
        return max(max(-int(n.min(initial=0)), int(n.max(initial=0))) for n in self._numbers)

    @property
    def cost(self) -> float:
        """Error and bits, roughly, in squared steps: what is least at one step is best."""
        bits = sum(float(rough_bits(n).sum()) for n in self._numbers if n.size)
        return self.squared_error / self.quantiser.step**2 + PRICE * bits

    @property
    def _numbers(self) -> tuple[Ints, Ints, Ints]:
        return self.basis, self.coefficients, self.maps

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
            self.parts,
            self.maps,
        )


def rough_bits(numbers: Ints) -> Floats:
    """Bits of each row, roughly: where its values are, their signs and magnitudes."""
    n = numbers.shape[1]
    occupied = np.count_nonzero(numbers, axis=1)
    share = np.maximum(occupied, 1) / n
    where = occupied * (np.log2(1.0 / share) + 1.4 * (1.0 - share))
    bits: Floats = where + occupied + 1.6 * np.log2(np.maximum(np.abs(numbers), 1)).sum(axis=1)
    return bits


def leading(used: Any) -> int:
    """Count the rows before the first that is all zero."""
    return len(used) if used.all() else int(np.argmin(used))
