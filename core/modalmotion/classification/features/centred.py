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
    harmonic_rows,
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
        self._flat: Array = a.reshape(len(a), -1)
        self._harmonics: dict[int, Array] = {}

    def harmonic_rows(self, count: int) -> Array:
        """First harmonics of all amplitudes, (2 count, modes * n) float64; not to be changed.

        Cosines of all, then sines.
        """
        found = self._harmonics.get(count)
        if found is None:
            found = harmonic_rows(self.share, self._flat, count)
            self._harmonics[count] = found
        return found

    @cached_property
    def products(self) -> Array:
        """Sums over time of products of all amplitudes, (modes * n, modes * n) float64."""
        products: Array = self._flat.T @ self._flat
        return products

    def amount(self, modes: slice | NDArray[np.int64]) -> tuple[float, float]:
        """RMS over time of what some modes move, as a share of the size, and its smooth share.

        See `smooth_share_of`.
        """
        total, followed = np.add.reduce(self._squares[:, modes], axis=1).tolist()
        n = len(self.amplitudes)
        return math.sqrt(total / n) / 100.0, smooth_share_of(n, total, followed)

    @cached_property
    def _squares(self) -> Array:
        """Sums over time and directions of the squares of each mode, (2, modes) float64.

        Of all, and of what the first harmonics follow.
        """
        _, n_modes, n_directions = self.amplitudes.shape
        by_mode = np.empty((2, n_modes * n_directions))
        np.einsum("ij,ij->j", self._flat, self._flat, out=by_mode[0])
        by_mode[1] = followed_squares(self.share, self._flat, N_SMOOTH, is_cycle=True)
        return np.asarray(np.add.reduce(by_mode.reshape(2, n_modes, n_directions), axis=2))


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
