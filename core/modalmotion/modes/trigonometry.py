"""Sines and cosines of rational multiples of pi, reduced in integers first.

A float argument p (2n - 1) pi / 2N loses 6e-10 at N = 1e6; reduced as an integer it loses
nothing. Zeros and ones come out exact.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np

from modalmotion.representation import Bools, Floats, Ints


def cos_pi(numerator: Ints, denominator: int) -> Floats:
    """cos(pi numerator / denominator).

    Parameters
    ----------
    numerator : (...) int64
    denominator : int
        Positive and below 2^60.

    Returns
    -------
    (...) float64
    """
    # cos is even with period 2, antisymmetric about 1/2: fold to [0, 1/2].
    k = numerator % (2 * denominator)
    k = np.minimum(k, 2 * denominator - k)
    above = 2 * k > denominator
    k = np.where(above, denominator - k, k)
    # The nearer of 0 and 1/2 is the origin, so that no argument exceeds pi / 4.
    from_half = denominator - 2 * k
    value = np.where(
        4 * k <= denominator,
        np.cos(np.pi * (k / denominator)),
        np.sin((np.pi / 2) * (from_half / denominator)),
    )
    return np.where(above, -value, value)


def sin_pi(numerator: Ints, denominator: int) -> Floats:
    """sin(pi numerator / denominator), to full relative precision near every zero.

    Parameters
    ----------
    numerator : (...) int64
    denominator : int
        Positive and below 2^60.

    Returns
    -------
    (...) float64
    """
    k = numerator % (2 * denominator)
    below = k > denominator
    k = np.where(below, 2 * denominator - k, k)
    k = np.minimum(k, denominator - k)
    from_half = denominator - 2 * k
    # At pi / 4 the cosine, as in `cos_pi`: the same angle has the same bits.
    value = np.where(
        4 * k < denominator,
        np.sin(np.pi * (k / denominator)),
        np.cos((np.pi / 2) * (from_half / denominator)),
    )
    return np.where(below, -value, value)


# Beyond this many parts of a turn single cosines cost less memory than all of a circle.
_LARGEST_CIRCLE: Final = 1 << 16


def cosines(factors: Ints, places: Ints, turn: int, is_sine: Bools) -> Floats:
    """cos, or sin, of 2 pi factor place / turn: whole numbers are reduced before the cosine.

    Parameters
    ----------
    factors : (m,) int64
    places : (n,) int64
    turn : int
    is_sine : (m,) bool
        For each factor.

    Returns
    -------
    (m, n) float64
    """
    parts = 4 * turn // math.gcd(turn, 4)
    # The sine is a quarter turn back.
    phase = exact_products(factors, places, turn) * (parts // turn)
    phase -= is_sine[:, None] * (parts // 4)
    if parts <= _LARGEST_CIRCLE:
        return circle_cosines(parts).take(phase, mode="wrap")
    return cos_pi(phase, parts // 2)


@lru_cache(maxsize=16)
def circle_cosines(turn: int) -> Floats:
    """Cosines of every whole multiple of 1 / `turn` of a turn, with the bits of `cos_pi`.

    Every factor of every mode of a lattice is one of these, so that whole axes cost an eighth
    of a turn of evaluations and a look-up.

    Parameters
    ----------
    turn : int
        A multiple of 4.

    Returns
    -------
    (turn,) float64
        cos(2 pi k / turn). The sine is a quarter turn back.
    """
    quarter, eighth = turn // 4, turn // 8
    angle = np.arange(eighth + 1.0)
    angle /= turn // 2
    angle *= np.pi
    cosines = np.empty(turn)
    np.cos(angle, out=cosines[: eighth + 1])
    cosines[quarter:eighth:-1] = np.sin(angle[: quarter - eighth])
    np.negative(cosines[quarter - 1 :: -1], out=cosines[quarter + 1 : 2 * quarter + 1])
    cosines[2 * quarter + 1 :] = cosines[2 * quarter - 1 : 0 : -1]
    return cosines


def exact_products(factors: Ints, others: Ints, modulus: int) -> Ints:
    """Outer products reduced modulo `modulus`, in exact integers of any length.

    Parameters
    ----------
    factors, others : (m,), (n,) int64
    modulus : int

    Returns
    -------
    (m, n) int64
        From 0 to `modulus` - 1.
    """
    most = _largest(factors) * _largest(others)
    if most < 2**62:
        reduced: Ints = np.multiply.outer(factors, others) % modulus
        return reduced
    exact = np.multiply.outer(factors.astype(object), others.astype(object)) % modulus
    return np.asarray(exact, dtype=np.int64)


def _largest(integers: Ints) -> int:
    return max(abs(int(integers.min(initial=0))), abs(int(integers.max(initial=0))))
