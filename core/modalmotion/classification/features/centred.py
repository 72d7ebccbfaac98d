"""A motion about its mean, over the size of the surface: what all readings about an axis share."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.temporal import (
    N_SMOOTH,
    cycle_share,
    followed_squares,
    harmonics,
    repeats_first,
    smooth_share_of,
    without_last,
)
from modalmotion.signature.making import ModalSignature

Array = NDArray[np.float64]


class CentredMotion:
    """One turn of a motion about its mean over time, in percent of the surface's size.

    Parameters
    ----------
    signature : ModalSignature
        Of one turn.

    Attributes
    ----------
    amplitudes : (frames, modes, n) float64
    share : (frames,) float64
        See `cycle_share`.
    """

    def __init__(self, signature: ModalSignature) -> None:
        along, around = signature.lengths
        # The roots are taken apart so that no product overflows.
        a = signature.amplitudes / math.sqrt(along)
        a /= math.sqrt(around)
        a *= 100.0
        a -= np.add.reduce(a) / len(a)
        self.amplitudes: Array = a
        self.share = cycle_share(signature)
        self._harmonics: dict[int, NDArray[np.complex128]] = {}

    def harmonics(self, count: int) -> NDArray[np.complex128]:
        """First harmonics of all amplitudes, (count, modes, n) complex128; not to be changed."""
        found = self._harmonics.get(count)
        if found is None:
            flat = self.amplitudes.reshape(len(self.amplitudes), -1)
            found = harmonics(self.share, flat, count).reshape(count, *self.amplitudes.shape[1:])
            self._harmonics[count] = found
        return found

    def size(self, modes: slice | NDArray[np.int64]) -> float:
        """RMS over time of what some modes move, as a share of the surface's size."""
        return math.sqrt(self._squares[0, modes].sum() / len(self.amplitudes)) / 100.0

    def smooth_share(self, modes: slice | NDArray[np.int64]) -> float:
        """Smooth share of what some modes move: see the function of this name."""
        total, followed = self._squares[:, modes].sum(axis=1).tolist()
        return smooth_share_of(len(self.share), total, followed)

    @cached_property
    def _squares(self) -> Array:
        """Sums over time and directions of the squares of each mode, (2, modes) float64.

        Of all, and of what the first harmonics follow.
        """
        n, n_modes, n_directions = self.amplitudes.shape
        flat = self.amplitudes.reshape(n, -1)
        total = np.einsum("ij,ij->j", flat, flat)
        followed = followed_squares(self.share, flat, N_SMOOTH, is_cycle=True)
        by_mode = np.stack([total, followed]).reshape(2, n_modes, n_directions)
        return np.asarray(np.add.reduce(by_mode, axis=2))


class CentredMotions:
    """Centred motion of a signature, made once for all that read its first modes.

    Parameters
    ----------
    signature : ModalSignature
        Of at least two frames, about an axis.
    """

    def __init__(self, signature: ModalSignature) -> None:
        self._signature = signature
        self._made: dict[bool, CentredMotion] = {}

    def of_first(self, n_modes: int) -> CentredMotion:
        """Motion of all modes over one turn, as long as the first modes say that it is."""
        # The modes of a reading say by themselves whether the last frame repeats the first.
        is_longer = bool(self._repeats[n_modes - 1])
        if is_longer not in self._made:
            signature = without_last(self._signature) if is_longer else self._signature
            self._made[is_longer] = CentredMotion(signature)
        return self._made[is_longer]

    @cached_property
    def _repeats(self) -> NDArray[np.bool_]:
        return repeats_first(self._signature.amplitudes)
