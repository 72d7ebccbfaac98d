"""Features of any topology that do not depend on pose, start or, where it is free, theta."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

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
    """

    names: tuple[str, ...]
    cosines: NDArray[np.int64]
    sines: NDArray[np.int64]
    turns: NDArray[np.int64]

    def modes(self, wave: int) -> tuple[int, ...]:
        """Give the indices of the modes of one wave."""
        both = int(self.cosines[wave]), int(self.sines[wave])
        return both if both[1] >= 0 else both[:1]

    @property
    def all_modes(self) -> tuple[int, ...]:
        """Indices of all modes."""
        return tuple(mode for wave in range(len(self.names)) for mode in self.modes(wave))


@lru_cache(maxsize=32)
def waves_of(modes: Modes, *, theta_is_free: bool) -> Waves:
    """Group modes into waves: each by itself, but pairs together where theta is free."""
    topology = modes.topology
    if topology is None or not theta_is_free:
        n = len(modes)
        return Waves(
            tuple(map(str, modes.labels)),
            np.arange(n),
            np.full(n, -1),
            np.zeros((n, 1), dtype=np.int64),
        )
    cosines, sines = wave_pairs(modes)
    wavenumbers = modes.wavenumbers[cosines]
    names = tuple(f"({', '.join(map(str, p))})" for p in wavenumbers.tolist())
    return Waves(names, cosines, sines, wavenumbers[:, list(topology.closed_axes)])


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
    z = stacked(motion, waves)
    sizes = np.sqrt((np.abs(z) ** 2).sum(axis=(2, 3)))
    both = np.concatenate([z.real, z.imag]).reshape(-1, z.shape[3])
    spread = np.linalg.svd(both, compute_uv=False, full_matrices=False)
    i, j = _pairs(waves)
    ahead = _cycle_lead if is_cycle else _course_lead
    parts = [sizes.T.ravel(), signed_root(_together(z[:, i], z[:, j]))]
    parts += [spread, signed_root(ahead(z[:, i], z[:, j]))]
    has_sine = waves.sines >= 0
    if has_sine.any():
        c, s = z[:, :, :1], z[:, :, 1:]
        parts.append(signed_root(ahead(c[:, has_sine], s[:, has_sine])))
        # Of two pairs: turning both by one angle keeps c.c' + s.s' and c.s' - s.c'.
        k = has_sine[i] & has_sine[j]
        i, j = i[k], j[k]
        for product in (_together, ahead):
            parts.append(signed_root(product(c[:, i], s[:, j]) - product(s[:, i], c[:, j])))
    return np.concatenate(parts)


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


def _together(a: NDArray[np.complex128], b: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Products of (terms, n, members, directions) over terms, members and directions, (n,)."""
    products: NDArray[np.float64] = np.einsum("hncd,hncd->n", a.conj(), b).real
    return products


def _cycle_lead(a: NDArray[np.complex128], b: NDArray[np.complex128]) -> NDArray[np.float64]:
    """How far a is ahead of b: the sine parts of the products of their harmonics, (n,)."""
    lead: NDArray[np.float64] = np.einsum("hncd,hncd->n", a.conj(), b).imag
    return lead


def _course_lead(a: NDArray[np.complex128], b: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Twice the signed area between the paths of a and b and their chord, (n,).

    int (a db - b da) says which of two moves first, however the time between is stretched
    (Chen, Integration of paths: a faithful representation of paths by noncommutative formal
    power series, Trans Am Math Soc, 1958).
    """
    area: NDArray[np.float64] = np.einsum("kncd,kl,lncd->n", a.real, _areas(len(a)), b.real)
    return area


@lru_cache(maxsize=32)
def _areas(n_terms: int) -> NDArray[np.float64]:
    """int_0^1 (c_k dc_l - c_l dc_k) of c_k = cos(k pi t), k from 1, (terms, terms)."""
    k = np.arange(1, n_terms + 1)
    k, m = k[:, None], k[None, :]
    # int c_k dc_l = -2 l^2 / (l^2 - k^2) where k + l is odd; otherwise the ends are equal.
    is_odd = (k + m) % 2 == 1
    apart = np.where(is_odd, k**2 - m**2, 1)
    areas: NDArray[np.float64] = np.where(is_odd, 2.0 * (k**2 + m**2) / apart, 0.0)
    areas.setflags(write=False)
    return areas


def stacked(motion: NDArray[np.complex128], waves: Waves) -> NDArray[np.complex128]:
    """Stack cosine and sine parts of a motion, (terms, waves, 2, directions)."""
    sines = np.where((waves.sines >= 0)[:, None], motion[:, waves.sines], 0.0)
    return np.stack([motion[:, waves.cosines], sines], axis=2)


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
    rooted: NDArray[np.float64] = np.sign(values) * np.sqrt(np.abs(values))
    return rooted
