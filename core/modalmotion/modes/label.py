"""Labels of modes: integer wavenumbers and a part, never a floating eigenvalue."""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.topology import CLOSED, OPEN, POLE_OPEN, Topology

# A wave has mean square 1/2 along each axis, or each wave vector of closed axes together.
_SCALES: Final = np.sqrt([1.0, 2.0, 4.0, 8.0])


class ModeLabel(NamedTuple):
    """Name of one mode.

    Parameters
    ----------
    wavenumbers : tuple of int
        One for each axis: counted from 0 on open and pole axes, the (signed) number of
        periods on closed ones. For a spring mode its place in the order of frequency.
    part : "cos", "sin" or "spring"
        One of the two shapes of a wave vector; "cos" where there is only one.
    """

    wavenumbers: tuple[int, ...]
    part: Literal["cos", "sin", "spring"]

    def __str__(self) -> str:
        numbers = ", ".join(map(str, self.wavenumbers))
        return f"(spring {numbers})" if self.part == "spring" else f"({numbers}, {self.part})"


def scales_of(n_waves: NDArray[np.int64]) -> NDArray[np.float64]:
    """Factors that give shapes with so many waves mean square 1, (modes,) float64."""
    scales: NDArray[np.float64] = _SCALES[n_waves]
    return scales


def odd_at_pole(topology: Topology, wavenumbers: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Where a pole axis carries the sine family: the closed axis after it has odd p'."""
    odd = np.zeros(wavenumbers.shape, dtype=np.bool_)
    for axis, ends in enumerate(topology.ends):
        if ends not in (OPEN, CLOSED):
            odd[:, axis] = wavenumbers[:, axis + 1] % 2 == 1
    return odd


def half_periods(topology: Topology, wavenumbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Half periods along each axis: see `ModeSet.half_periods`."""
    odd = odd_at_pole(topology, wavenumbers)
    h = wavenumbers.copy()
    for axis, ends in enumerate(topology.ends):
        if ends == CLOSED:
            continue
        # open: cos(p pi s). cup: cos(r pi s), sin((r + 1/2) pi s).
        # sphere: cos(r pi s), sin((r + 1) pi s).
        h[:, axis] = 2 * wavenumbers[:, axis]
        h[:, axis] += odd[:, axis] * (1 if ends == POLE_OPEN else 2)
    return h
