"""Features of any topology that depend neither on the start nor, where it is free, on theta."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.motion import Column
from modalmotion.modes import Modes, wave_pairs

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Waves(NamedTuple):
    """Modes taken together where a start angle would mix them: each alone, or pairs.

    Parameters
    ----------
    names : tuple of str
    modes : tuple of tuple of int
        Cosine and, where theta is free, sine of each.
    i, j : (pairs,) int64
        Waves whose products a start angle keeps: those of the same turns.
    """

    names: tuple[str, ...]
    modes: tuple[tuple[int, ...], ...]
    i: Index
    j: Index


@lru_cache(maxsize=64)
def waves_of(modes: Modes, *, walls: bool) -> Waves:
    """Group modes into waves."""
    topology = modes.topology
    members: tuple[tuple[int, ...], ...]
    turns: list[tuple[int, ...]]
    if topology is None or not topology.closed_axes or walls:
        names, turns = tuple(map(str, modes.labels)), [()] * len(modes)
        members = tuple((k,) for k in range(len(modes)))
    else:
        cosines, sines = wave_pairs(modes)
        numbers = modes.wavenumbers[cosines]
        names = tuple(f"({', '.join(map(str, p))})" for p in numbers.tolist())
        members = tuple(
            (c, s) if s >= 0 else (c,)
            for c, s in zip(cosines.tolist(), sines.tolist(), strict=True)
        )
        turns = list(map(tuple, numbers[:, list(topology.closed_axes)].tolist()))
    n = len(names)
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n) if turns[i] == turns[j]]
    i, j = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return Waves(names, members, i, j)


def theta_is_free(modes: Modes, *, walls: bool) -> bool:
    """Whether modes as they are depend on a start angle that is arbitrary."""
    return any(len(group) > 1 for group in waves_of(modes, walls=walls).modes)


def wave_features(terms: NDArray[Any], waves: Waves, *, ahead: bool = True) -> Array:
    """Roots of products of modes over all terms, (features,) float64; see `wave_columns`.

    Parameters
    ----------
    terms : (terms, modes, n)
        Complex harmonics of a cycle, or real cosine terms of a transient.
    waves : Waves
    ahead : bool
        Whether to read which mode moves first; a shape at rest has no order.
    """
    is_cycle = np.iscomplexobj(terms)
    parts = np.concatenate([terms.real, terms.imag]) if is_cycle else terms
    sizes = (np.abs(terms) ** 2).sum(axis=2)
    c = np.array([group[0] for group in waves.modes])
    # A wave without a sine has one of zeros, behind the last mode.
    zero = terms.shape[1]
    s = np.array([group[1] if len(group) > 1 else zero for group in waves.modes])
    sizes = np.pad(sizes, ((0, 0), (0, 1)))
    own = _flat(parts)
    spread = np.linalg.svd(parts.reshape(-1, terms.shape[2]), compute_uv=False)
    spread = np.pad(spread, (0, terms.shape[2] - len(spread)))
    both = own @ own.T
    i, j = waves.i, waves.j
    found = [np.sqrt(sizes[:, c] + sizes[:, s]).T.ravel(), spread]
    # Of pairs a start angle keeps c.c' + s.s' and c.s' - s.c'.
    products = [both[c[i], c[j]] + both[s[i], s[j]]]
    paired = s < zero
    turned = paired[i] & paired[j]
    products.append((both[c[i], s[j]] - both[s[i], c[j]])[turned])
    if ahead:
        if is_cycle:
            led = own @ _flat(np.concatenate([terms.imag, -terms.real])).T
        else:
            led = own @ _flat(np.tensordot(_areas(len(terms)), terms, axes=1)).T
        products += [
            led[c[i], c[j]] + led[s[i], s[j]],
            led[c, s][paired],
            (led[c[i], s[j]] - led[s[i], c[j]])[turned],
        ]
    flat = np.concatenate(products)
    return np.concatenate([*found, np.copysign(np.sqrt(np.abs(flat)), flat)])


def wave_columns(
    waves: Waves, n_terms: int, n_directions: int, *, ahead: bool = True
) -> tuple[Column, ...]:
    """Columns of the values of `wave_features`: sizes, what moves together, what moves first."""
    every = tuple(k for group in waves.modes for k in group)
    paired = [len(group) > 1 for group in waves.modes]

    def of_pairs(what: str, needs_sine: bool) -> list[Column]:
        return [
            Column(f"{what} {waves.names[i]} {waves.names[j]}", waves.modes[i] + waves.modes[j])
            for i, j in zip(waves.i.tolist(), waves.j.tolist(), strict=True)
            if not needs_sine or (paired[i] and paired[j])
        ]

    columns = [
        Column(f"size {name} term {h}", group)
        for name, group in zip(waves.names, waves.modes, strict=True)
        for h in range(1, n_terms + 1)
    ]
    columns += [Column(f"spread {k}", every) for k in range(1, n_directions + 1)]
    columns += of_pairs("together", False) + of_pairs("beside", True)
    if ahead:
        columns += of_pairs("ahead", False)
        columns += [
            Column(f"runs {name}", group)
            for name, group, has in zip(waves.names, waves.modes, paired, strict=True)
            if has
        ]
        columns += of_pairs("ahead beside", True)
    return tuple(columns)


def summary(terms: NDArray[Any], waves: Waves) -> Array:
    """Few numbers for few cases: how much each wave, each term and each direction moves."""
    squares = (np.abs(terms) ** 2).sum(axis=2)
    by_wave = np.array([squares[:, list(group)].sum() for group in waves.modes])
    is_cycle = np.iscomplexobj(terms)
    parts = np.concatenate([terms.real, terms.imag]) if is_cycle else terms
    spread = np.linalg.svd(parts.reshape(-1, terms.shape[2]), compute_uv=False)
    found = [np.sqrt(by_wave), np.sqrt(squares.sum(axis=1)), spread]
    if not is_cycle:
        # The start of a transient is known, so signs of its terms to each other say when.
        flat = terms.reshape(len(terms), -1)
        pairs = (flat @ flat.T)[np.triu_indices(len(terms), 1)]
        found.append(np.copysign(np.sqrt(np.abs(pairs)), pairs))
    return np.concatenate(found)


def summary_columns(
    waves: Waves, n_terms: int, n_directions: int, *, is_cycle: bool
) -> tuple[Column, ...]:
    """Columns of the values of `summary`."""
    every = tuple(k for group in waves.modes for k in group)
    columns = [
        Column(f"size {n}", group) for n, group in zip(waves.names, waves.modes, strict=True)
    ]
    columns += [Column(f"size term {h}", every) for h in range(1, n_terms + 1)]
    columns += [Column(f"spread {k}", every) for k in range(1, n_directions + 1)]
    if not is_cycle:
        pairs = zip(*np.triu_indices(n_terms, 1), strict=True)
        columns += [Column(f"term {i + 1} with {j + 1}", every) for i, j in pairs]
    return tuple(columns)


def _flat(terms: NDArray[Any]) -> Array:
    """Rows of the modes' terms, and one of zeros: (modes + 1, terms * n)."""
    rows = terms.transpose(1, 0, 2).reshape(terms.shape[1], -1)
    return np.asarray(np.pad(rows, ((0, 1), (0, 0))))


@lru_cache(maxsize=32)
def _areas(n_terms: int) -> Array:
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
    return np.where(is_odd, 2.0 * (k**2 + m**2) / apart, 0.0)
