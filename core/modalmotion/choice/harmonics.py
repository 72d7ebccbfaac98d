"""Harmonics: the few functions of time that limit a trajectory, by least squares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError
from modalmotion.numeric.products import product

MOST_HARMONICS: Final = 64
"""Largest number of harmonics; a path that needs more is given as its frames."""

# Uneven times tell harmonics apart up to this condition.
_LARGEST_CONDITION: Final = 1e3


@dataclass(frozen=True, eq=False)
class Harmonics:
    """Orthonormal functions of the frames, the slow ones first.

    A constant and a straight line in time, then cosine and sine of each harmonic: least
    squares on the times as they are, even or not. The line takes up the distance between the
    ends of a movement that does not come back, so that no cycle is closed by force.

    Parameters
    ----------
    functions : (frames, functions) float64
        Orthonormal columns.
    """

    functions: NDArray[np.float64]

    @property
    def most(self) -> int:
        """Largest number of harmonics."""
        return max(int(self.functions.shape[1]) - 2, 0) // 2

    def limited(self, amplitudes: NDArray[np.float64], harmonics: int) -> NDArray[np.float64]:
        """Limit paths over time to so many harmonics.

        Parameters
        ----------
        amplitudes : (frames, modes, 3) float64
        harmonics : int

        Returns
        -------
        (frames, modes, 3) float64
        """
        T = np.ascontiguousarray(self.functions[:, : n_functions(harmonics)])
        flat = np.ascontiguousarray(amplitudes.reshape(len(amplitudes), -1))
        return product(T, product(np.ascontiguousarray(T.T), flat)).reshape(amplitudes.shape)


def n_functions(harmonics: int) -> int:
    """Count the numbers of each amplitude's path: the line's two besides the harmonics'."""
    return 2 * harmonics + 2


def harmonics_of(n_frames: int, times: NDArray[np.float64] | None) -> Harmonics:
    """Make the functions of time of a sequence, as many as its frames tell apart.

    Parameters
    ----------
    n_frames : int
    times : (frames,) float64, s, or None
        Even steps if there are none. One turn of a cycle is one even step longer.
    """
    at = np.arange(n_frames, dtype=np.float64) if times is None else times - times[0]
    if n_frames == 1:
        return Harmonics(np.ones((1, 1)))
    x = at / (at[-1] * n_frames / (n_frames - 1))
    columns = [np.ones(n_frames), x - x.mean()]
    for p in range(1, MOST_HARMONICS + 1):
        if len(columns) + 2 > n_frames:
            break
        pair = [np.cos(2 * np.pi * p * x), np.sin(2 * np.pi * p * x)]
        if np.linalg.cond(np.stack([*columns, *pair], axis=1)) > _LARGEST_CONDITION:
            break
        columns += pair
    functions, R = np.linalg.qr(np.stack(columns, axis=1))
    return Harmonics(functions * np.where(np.diag(R) < 0, -1.0, 1.0))


def require_harmonics(harmonics: int, available: Harmonics) -> None:
    """Refuse more harmonics than the frames tell apart.

    Raises
    ------
    ParameterError
    """
    if harmonics > available.most:
        raise ParameterError(
            f"{harmonics} harmonics cannot be told apart in {len(available.functions)} frames.",
            remedy=f"Ask for at most {available.most}, or leave the path over time as it is.",
            details={"harmonics": harmonics, "most": available.most},
        )
