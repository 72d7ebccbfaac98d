"""What a recording is like beside its kind of motion: how large, how long, how it closes."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.temporal import Turn, Turns, harmonic_rows
from modalmotion.mesh.sequence import MM_PER_UNIT
from modalmotion.signature.making import ModalSignature

MEASURES: Final = ("size", "elongation", "gap", "leap", "turns")
"""log of the size, in mm where the unit is known; log of the extent of the reference in its longest
direction over that across it; log of the step from the last
frame to the first over its neighbours, and of the largest step over the usual one; log of what
moves several times in the recording over what moves once."""

_N_HARMONICS: Final = 4

# Modes that say what a shape is like, and the extent, over the longest, of one that is flat.
_FEWEST_OF_SHAPE: Final = 3
_FLAT: Final = 1e-6

# Steps below this share of the usual one are rest, and noise.
_REST: Final = 0.1


def measures(signature: ModalSignature, turn: Turn | None = None) -> NDArray[np.float64]:
    """Values of `MEASURES`, (measures,) float64; NaN for what the recording does not tell."""
    unit = signature.unit
    size = signature.modes.length_of(
        signature.lengths, signature.angular_frequencies, signature.parameters.wave_speed
    )
    known = 1.0 if unit is None else MM_PER_UNIT[unit]
    turn = turn or Turns(signature).of_first()
    a = turn.signature.amplitudes.reshape(len(turn.share), -1)
    return np.array(
        [
            _log(size * known),
            _elongation(signature.reference_amplitudes),
            *_steps(a),
            _turns(turn.share, a),
        ]
    )


def _elongation(reference: NDArray[np.float64]) -> float:
    """Log of the first extent of a shape over the second, however it is turned."""
    if len(reference) < _FEWEST_OF_SHAPE:
        return math.nan
    first, second = np.linalg.svd(reference, compute_uv=False)[:2].tolist()
    return math.log(first / second) if second > _FLAT * first else math.nan


def _steps(a: NDArray[np.float64]) -> tuple[float, float]:
    """Give logs of the step that closes a cycle over its neighbours, and of the largest one."""
    n = len(a)
    if n < 4:
        return math.nan, math.nan
    apart = a - a[np.arange(n) - 1]
    steps = np.sqrt(np.einsum("ij,ij->i", apart, apart))
    usual = math.sqrt(float(np.vdot(steps[1:], steps[1:])) / (n - 1))
    if usual == 0.0:
        return math.nan, math.nan
    beside = 0.5 * (steps[1] + steps[-1]) + _REST * usual
    return _log((float(steps[0]) + _REST * usual) / beside), _log(float(steps.max()) / usual)


def _turns(share: NDArray[np.float64], a: NDArray[np.float64]) -> float:
    rows = harmonic_rows(share, a - np.add.reduce(a) / len(a), _N_HARMONICS)
    squares = np.einsum("ij,ij->i", rows, rows).tolist()
    first, *others = (
        cosine + sine
        for cosine, sine in zip(squares[:_N_HARMONICS], squares[_N_HARMONICS:], strict=True)
    )
    return 0.5 * _log(sum(others) / first) if first > 0 else math.nan


def _log(value: float) -> float:
    return math.log(value) if value > 0 else math.nan
