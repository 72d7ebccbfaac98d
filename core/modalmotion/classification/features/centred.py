"""A motion about its mean, over the size of the surface: what all readings about an axis share."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.temporal import Turn, Turns, cycle_fit, smooth_share_of
from modalmotion.signature.making import ModalSignature

Array = NDArray[np.float64]


class CentredMotion:
    """One turn of a motion about its mean over time, in percent of the surface's size.

    Parameters
    ----------
    turn : Turn

    Attributes
    ----------
    amplitudes : (frames, modes, n) float64
    share : (frames,) float64
        See `cycle_share`.
    """

    def __init__(self, turn: Turn) -> None:
        along, around = turn.signature.lengths
        # The roots are taken apart so that no product overflows.
        a = turn.signature.amplitudes / math.sqrt(along)
        a *= 100.0 / math.sqrt(around)
        a -= np.add.reduce(a) / len(a)
        self.amplitudes: Array = a
        self.share = turn.share
        self._flat: Array = a.reshape(len(a), -1)
        self._harmonics: dict[int, Array] = {}
        self._followed: Array | None = None

    def harmonic_rows(self, count: int) -> Array:
        """First harmonics of all amplitudes, (2 count, modes * n) float64; not to be changed.

        Cosines of all, then sines.
        """
        found = self._harmonics.get(count)
        if found is None:
            found, self._followed = cycle_fit(self.share, self._flat, count)
            self._harmonics[count] = found
        return found

    @cached_property
    def products(self) -> Array:
        """Sums over time of products of all amplitudes, (modes * n, modes * n) float64."""
        products: Array = self._flat.T @ self._flat
        return products

    def amount(self, some: Array) -> tuple[float, float]:
        """RMS over time of what some modes move, as a share of the size, and its smooth share.

        See `smooth_share_of`.

        Parameters
        ----------
        some : (first modes * n,) float64
            1 for the amplitudes of these modes, 0 for others.
        """
        total, followed = (self._squares[:, : len(some)] @ some).tolist()
        n = len(self.amplitudes)
        return math.sqrt(total / n) / 100.0, smooth_share_of(n, total, followed)

    @cached_property
    def _squares(self) -> Array:
        """Sums over time of the squares of each amplitude, (2, modes * n) float64.

        Of all, and of what the first harmonics follow.
        """
        if self._followed is None:
            self.harmonic_rows(1)
        assert self._followed is not None  # noqa: S101 (it comes with the harmonics)
        return np.array([self.products.diagonal(), self._followed])


class CentredMotions:
    """Centred motion of a signature, made once for all that read its first modes.

    Parameters
    ----------
    signature : ModalSignature
        Of at least two frames, about an axis.
    turns : Turns, optional
        Of the signature.
    """

    def __init__(self, signature: ModalSignature, turns: Turns | None = None) -> None:
        self._turns = turns or Turns(signature)
        self._made: dict[int, CentredMotion] = {}

    def of_first(self, n_modes: int) -> CentredMotion:
        """Motion of all modes over one turn, as long as the first modes say that it is."""
        turn = self._turns.of_first(n_modes)
        n_frames = len(turn.share)
        if n_frames not in self._made:
            self._made[n_frames] = CentredMotion(turn)
        return self._made[n_frames]
