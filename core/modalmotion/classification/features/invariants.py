"""Features of any topology that do not depend on pose, start or, where it is free, theta."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.columns import Column
from modalmotion.modes import Modes, wave_pairs


@dataclass(frozen=True, eq=False)
class Waves:
    """Modes taken together where a start angle would mix them.

    Parameters
    ----------
    names : tuple of str
    cosines, sines : (waves,) int64
        Indices of the modes; the sine is -1 where there is none, or where theta is fixed.
    turns : (waves, axes) int64
        Waves of the same turns keep their products under a start angle.
    n_modes : int
        Of all.
    """

    names: tuple[str, ...]
    cosines: NDArray[np.int64]
    sines: NDArray[np.int64]
    turns: NDArray[np.int64]
    n_modes: int

    def modes(self, wave: int) -> tuple[int, ...]:
        """Give the indices of the modes of one wave."""
        both = int(self.cosines[wave]), int(self.sines[wave])
        return both if both[1] >= 0 else both[:1]

    @cached_property
    def all_modes(self) -> tuple[int, ...]:
        """Indices of all modes."""
        return tuple(mode for wave in range(len(self.names)) for mode in self.modes(wave))


@lru_cache(maxsize=64)
def waves_of(modes: Modes, *, theta_is_free: bool) -> Waves:
    """Group modes into waves: each by itself, but pairs together where theta is free.

    Only a topology with a closed axis has such an angle.
    """
    topology = modes.topology
    if topology is None or not topology.closed_axes or not theta_is_free:
        n = len(modes)
        return Waves(
            tuple(map(str, modes.labels)),
            np.arange(n),
            np.full(n, -1),
            np.zeros((n, 1), dtype=np.int64),
            n,
        )
    cosines, sines = wave_pairs(modes)
    wavenumbers = modes.wavenumbers[cosines]
    names = tuple(f"({', '.join(map(str, p))})" for p in wavenumbers.tolist())
    return Waves(names, cosines, sines, wavenumbers[:, list(topology.closed_axes)], len(modes))


def invariants(
    motion: NDArray[np.complex128], waves: Waves, *, is_cycle: bool
) -> NDArray[np.float64]:
    """Values of the columns of `invariant_columns`.

    Parameters
    ----------
    motion : (terms, modes, n) complex128
        Harmonics of a cycle; of a course cosine terms, which are real.
    waves : Waves
    is_cycle : bool

    Returns
    -------
    (features,) float64
        All in the unit of the motion: roots of squares and of products.
    """
    places = _places(waves)
    n_terms, n_modes, _ = motion.shape
    if is_cycle:
        parts = np.concatenate([motion.real, motion.imag])
        led = np.concatenate([motion.imag, -motion.real])
    else:
        parts = motion.real
        led = (areas(n_terms) @ parts.reshape(n_terms, -1)).reshape(parts.shape)
    own, other = (x.transpose(1, 0, 2).reshape(n_modes, -1) for x in (parts, led))
    # Of each mode with each: what moves together, and how far the first is ahead.
    products = np.empty((2, n_modes, n_modes))
    np.matmul(own, own.T, out=products[0])
    np.matmul(own, other.T, out=products[1])
    flat = products.ravel()
    found = flat.take(places.first)
    if places.second is not None:
        found += places.signs * flat.take(places.second)
    rooted = signed_root(found)
    squares, spread = sizes(motion, waves, is_cycle=is_cycle)
    n = places.n_together
    return np.concatenate([np.sqrt(squares).T.ravel(), rooted[:n], spread, rooted[n:]])


def still_invariants(shape: NDArray[np.float64], waves: Waves) -> NDArray[np.float64]:
    """Sizes, what is together and the spread of one real term: the first of its `invariants`.

    Parameters
    ----------
    shape : (modes, n) float64
    waves : Waves
    """
    first, second, signs = _still_places(waves)
    products = (shape @ shape.T).ravel()
    found = products.take(first)
    if second is not None:
        found += signs * products.take(second)
    return np.concatenate([signed_root(found), _spread(shape, waves)])


def sizes(
    motion: NDArray[np.complex128], waves: Waves, *, is_cycle: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Squares of the terms of each wave, and how far the motion spreads in each direction.

    Returns
    -------
    squares : (terms, waves) float64
        Sums over the wave's modes and all directions.
    spread : (directions,) float64
        Singular values of all terms together.
    """
    places = _places(waves)
    # A course has real terms.
    parts = np.concatenate([motion.real, motion.imag]) if is_cycle else motion.real
    by_mode = np.add.reduce(np.square(parts), axis=2)
    if is_cycle:
        by_mode = by_mode[: len(motion)] + by_mode[len(motion) :]
    return np.asarray(by_mode @ places.members), _spread(parts, waves)


def _spread(parts: NDArray[np.float64], waves: Waves) -> NDArray[np.float64]:
    """Singular values, (n,) float64, of terms (..., modes, n)."""
    if not _places(waves).is_whole:
        parts = parts[..., list(waves.all_modes), :]
    n_directions = parts.shape[-1]
    parts = parts.reshape(-1, n_directions)
    spread = np.asarray(np.linalg.svd(parts, compute_uv=False), dtype=np.float64)
    if len(spread) < n_directions:
        spread = np.append(spread, np.zeros(n_directions - len(spread)))
    return spread


class _Places(NamedTuple):
    """Where modes and their products lie, which features are made of.

    Parameters
    ----------
    members : (modes, waves) float64
        1 for the modes of each wave.
    is_whole : bool
        Whether each mode is in a wave.
    first : (features,) int64
        Products of two modes in two tables, flattened: moving together, and one ahead.
    second : (features,) int64 or None
        Products that are added; None where waves are of one mode each.
    signs : (features,) float64
        1, -1 where they are taken off, and 0 where there is nothing to add.
    n_together : int
        Features that say what moves together, which come first.
    """

    members: NDArray[np.float64]
    is_whole: bool
    first: NDArray[np.int64]
    second: NDArray[np.int64] | None
    signs: NDArray[np.float64]
    n_together: int


@lru_cache(maxsize=64)
def _places(waves: Waves) -> _Places:
    n = waves.n_modes
    every = waves.all_modes
    members = np.zeros((n, len(waves.names)))
    for wave in range(len(waves.names)):
        members[list(waves.modes(wave)), wave] = 1.0
    c, s, has_sine = waves.cosines, waves.sines, waves.sines >= 0
    i, j = _pairs(waves)

    def product(a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.int64]:
        return a * n + b

    both = has_sine[i] & has_sine[j]
    of_sines = np.where(both, product(s[i], s[j]), 0)
    # Of two pairs turning both by one angle keeps c.c' + s.s' and c.s' - s.c'.
    beside = product(c[i], s[j])[both], product(s[i], c[j])[both]
    ahead, runs = n * n, product(c, s)[has_sine]
    first = [product(c[i], c[j]), ahead + product(c[i], c[j])]
    second = [of_sines, ahead + of_sines]
    signs = [both.astype(np.float64)] * 2
    if has_sine.any():
        first += [ahead + runs, beside[0], ahead + beside[0]]
        second += [runs, beside[1], ahead + beside[1]]
        signs += [np.zeros(len(runs)), -np.ones(len(beside[0])), -np.ones(len(beside[0]))]
    return _Places(
        members=members,
        is_whole=len(every) == n,
        first=np.concatenate(first),
        second=np.concatenate(second) if has_sine.any() else None,
        signs=np.concatenate(signs),
        n_together=len(i),
    )


@lru_cache(maxsize=64)
def _still_places(
    waves: Waves,
) -> tuple[NDArray[np.int64], NDArray[np.int64] | None, NDArray[np.float64]]:
    """Places of the products of each wave with itself, and of what is together: as `_Places`."""
    places, n = _places(waves), _places(waves).n_together
    c, s, has_sine = waves.cosines, waves.sines, waves.sines >= 0
    # The square of a mode is on the diagonal.
    step = waves.n_modes + 1
    first = np.concatenate([step * c, places.first[:n]])
    signs = np.concatenate([has_sine.astype(np.float64), places.signs[:n]])
    if places.second is None:
        return first, None, signs
    return first, np.concatenate([np.where(has_sine, step * s, 0), places.second[:n]]), signs


@lru_cache(maxsize=64)
def invariant_columns(
    waves: Waves, n_terms: int, n_directions: int, *, is_cycle: bool
) -> tuple[Column, ...]:
    """Columns of the values of `invariants`."""
    term = "harmonic" if is_cycle else "term"
    columns = [
        Column(f"size {name} {term} {h}", waves.modes(k))
        for k, name in enumerate(waves.names)
        for h in range(1, n_terms + 1)
    ]
    pairs = list(zip(*(index.tolist() for index in _pairs(waves)), strict=True))
    everything = waves.all_modes

    def of_pairs(what: str, index_pairs: list[tuple[int, int]]) -> list[Column]:
        return [
            Column(f"{what} {waves.names[i]} {waves.names[j]}", waves.modes(i) + waves.modes(j))
            for i, j in index_pairs
        ]

    columns += of_pairs("together", pairs)
    columns += [Column(f"spread {axis}", everything) for axis in range(1, n_directions + 1)]
    columns += of_pairs("ahead", pairs)
    has_sine = waves.sines >= 0
    columns += [Column(f"runs {waves.names[k]}", waves.modes(k)) for k in np.flatnonzero(has_sine)]
    if has_sine.any():
        both = [(i, j) for i, j in pairs if has_sine[i] and has_sine[j]]
        columns += of_pairs("beside", both) + of_pairs("ahead beside", both)
    return tuple(columns)


@lru_cache(maxsize=32)
def areas(n_terms: int) -> NDArray[np.float64]:
    """int_0^1 (c_k dc_l - c_l dc_k) of c_k = cos(k pi t), k from 1, (terms, terms).

    int (a db - b da), twice the signed area between the paths of two modes and their chord, says
    which of two moves first, however the time between is stretched (Chen, Integration of paths: a
    faithful representation of paths by noncommutative formal power series, Trans Am Math Soc,
    1958).
    """
    k = np.arange(1, n_terms + 1)
    k, m = k[:, None], k[None, :]
    # int c_k dc_l = -2 l^2 / (l^2 - k^2) where k + l is odd; otherwise the ends are equal.
    is_odd = (k + m) % 2 == 1
    apart = np.where(is_odd, k**2 - m**2, 1)
    found: NDArray[np.float64] = np.where(is_odd, 2.0 * (k**2 + m**2) / apart, 0.0)
    found.setflags(write=False)
    return found


@lru_cache(maxsize=32)
def _pairs_of(turns: tuple[tuple[int, ...], ...]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    n = len(turns)
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n) if turns[i] == turns[j]]
    both = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return both[:, 0], both[:, 1]


def _pairs(waves: Waves) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    return _pairs_of(tuple(map(tuple, waves.turns.tolist())))


def signed_root(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Root of the magnitude, with the sign."""
    rooted: NDArray[np.float64] = np.copysign(np.sqrt(np.abs(values)), values)
    return rooted
