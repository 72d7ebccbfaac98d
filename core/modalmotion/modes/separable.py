"""Modes as sums of products of one function per axis: the structure of labels, no values."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ModeCountError, ParameterError
from modalmotion.modes.topology import CLOSED, Topology
from modalmotion.representation import shown


@shown("term", "mode", "product")
class Terms(NamedTuple):
    """Some of the terms of a set of modes.

    Parameters
    ----------
    term : (terms,) int64
        Their numbers among all terms.
    mode : (terms,) int64
        The mode each belongs to.
    product : (terms,) int64
        The product each is a multiple of, numbered row by row over the axes' functions.
    """

    term: NDArray[np.int64]
    mode: NDArray[np.int64]
    product: NDArray[np.int64]


@shown("topology", "n_functions")
@dataclass(frozen=True, eq=False)
class Separable:
    """Functions along the axes, and how they multiply and add up to modes.

    A mode is scale * sum of terms, a term +1 or -1 times a product of one function for each
    axis. One closed axis or none: one term. cos(a + b) = cos a cos b - sin a sin b: two on a
    torus, four on three closed axes.

    Parameters
    ----------
    topology : Topology
    half_periods : tuple of (functions, 1) int64
        For each axis the distinct h >= 0, as in `ModeSet.half_periods`.
    is_sine : tuple of (functions, 1) int64
        1 where the function is a sine: sin(2 pi h theta) or, at a pole, sin(h pi s / 2).
    columns : (terms, axes) int64
        Functions of each term.
    mode : (terms,) int64
    signs : (terms,) float64
    """

    topology: Topology
    half_periods: tuple[NDArray[np.int64], ...]
    is_sine: tuple[NDArray[np.int64], ...]
    columns: NDArray[np.int64]
    mode: NDArray[np.int64]
    signs: NDArray[np.float64]

    @cached_property
    def n_functions(self) -> tuple[int, ...]:
        """Number of distinct functions along each axis."""
        return tuple(len(h) for h in self.half_periods)

    @cached_property
    def n_products(self) -> int:
        """Number of products of one function for each axis, used or not."""
        return math.prod(self.n_functions)

    @cached_property
    def largest(self) -> tuple[int, ...]:
        """Largest h along each axis."""
        return tuple(int(h.max(initial=0)) for h in self.half_periods)

    @cached_property
    def has_sine(self) -> tuple[bool, ...]:
        """Whether any function along each axis is a sine."""
        return tuple(bool(sine.any()) for sine in self.is_sine)

    @cached_property
    def waves(self) -> tuple[tuple[NDArray[np.int64], int], ...]:
        """Multiples of the smallest angle that each axis needs, and that angle.

        Returns
        -------
        tuple of ((functions, 1) int64, int)
            For each axis m and d: the functions are cos or sin(m 2 pi n / N) on a closed axis,
            where d is 1, and cos or sin(m 2 pi (2n - 1) / dN) on any other.
        """
        waves = []
        for ends, h in zip(self.topology.ends, self.half_periods, strict=True):
            if ends == CLOSED:
                waves.append((h, 1))
            else:
                # cos(h pi (2n - 1) / 4N): half as fine when all h are even.
                waves.append((h, 8) if (h % 2).any() else (h // 2, 4))
        return tuple(waves)

    @cached_property
    def sums(self) -> tuple[Terms, ...]:
        """The terms, first terms of all modes first: no mode twice in one group."""
        return self._groups(self.mode)

    @cached_property
    def spreads(self) -> tuple[Terms, ...]:
        """The terms in groups that name no product twice."""
        return self._groups(self._product)

    @cached_property
    def _product(self) -> NDArray[np.int64]:
        flat = np.zeros(len(self.mode), dtype=np.int64)
        for axis, n in enumerate(self.n_functions):
            flat = flat * n + self.columns[:, axis]
        return flat

    def _groups(self, key: NDArray[np.int64]) -> tuple[Terms, ...]:
        """Terms in groups that have no key twice, sorted by key within each."""
        order = np.argsort(key, kind="stable")
        ordered = key[order]
        first = np.flatnonzero(np.diff(ordered, prepend=-1))
        rank = np.arange(len(key)) - np.repeat(first, np.diff(first, append=len(key)))
        groups = []
        for r in range(int(rank.max(initial=-1)) + 1):
            term = order[rank == r]
            groups.append(Terms(term, self.mode[term], self._product[term]))
        return tuple(groups)


def separate(
    topology: Topology,
    half_periods: NDArray[np.int64],
    is_odd_at_pole: NDArray[np.bool_],
    is_sine: NDArray[np.bool_],
) -> Separable:
    """Write modes as sums of products of one function per axis.

    Parameters
    ----------
    topology : Topology
    half_periods : (modes, axes) int64
    is_odd_at_pole : (modes, axes) bool
    is_sine : (modes,) bool

    Raises
    ------
    ModeCountError
        If `half_periods` is empty.
    ParameterError
        If a mode is the sine of a wave vector without any period, which is zero.
    """
    if not len(is_sine):
        raise ModeCountError("There are no modes.", remedy="Use at least one mode.")
    expanded = list(expand(topology, half_periods, is_odd_at_pole, is_sine))
    mode = np.concatenate([terms.mode for terms in expanded])
    order = np.argsort(mode, kind="stable")
    mode = mode[order]
    if len(np.unique(mode)) != len(is_sine):
        raise ParameterError(
            "The sine of a wave vector without any period is zero everywhere and not a mode.",
            remedy="Ask for its cosine alone.",
        )
    family = np.concatenate([terms.is_sine for terms in expanded])[order]
    h = np.abs(half_periods[mode])
    distinct = [
        np.unique(2 * h[:, axis] + family[:, axis], return_inverse=True)
        for axis in range(topology.n_axes)
    ]
    return Separable(
        topology,
        tuple((key // 2)[:, None] for key, _ in distinct),
        tuple((key % 2)[:, None] for key, _ in distinct),
        np.stack([column for _, column in distinct], axis=1),
        mode,
        np.concatenate([terms.sign for terms in expanded])[order].astype(np.float64),
    )


class Expansion(NamedTuple):
    """One product of the expansion of cos or sin(a + b + ...), of every mode that has it.

    Parameters
    ----------
    sines : tuple of bool
        For each closed axis whether its factor is the sine.
    mode : (terms,) int64
        No mode twice.
    is_sine : (terms, axes) bool
        As `sines`, and on pole axes whether the factor is the sine that vanishes at the pole.
    sign : (terms,) int8
    """

    sines: tuple[bool, ...]
    mode: NDArray[np.int64]
    is_sine: NDArray[np.bool_]
    sign: NDArray[np.int8]


def expand(
    topology: Topology,
    half_periods: NDArray[np.int64],
    is_odd_at_pole: NDArray[np.bool_],
    is_sine: NDArray[np.bool_],
) -> Iterator[Expansion]:
    """Expand the waves over several closed axes into products; parameters as `separate`."""
    closed = topology.closed_axes
    # Re and Im of prod (cos + i sin): an even number of sines in a cosine, odd in a sine.
    for sines in product((False, True), repeat=len(closed)):
        n_sines = sum(sines)
        belongs = is_sine == bool(n_sines % 2)
        for axis, sine in zip(closed, sines, strict=True):
            if sine:
                belongs &= half_periods[:, axis] != 0
        mode = np.flatnonzero(belongs)
        family = is_odd_at_pole[mode]
        sign = np.full(len(mode), -1 if n_sines // 2 % 2 else 1, dtype=np.int8)
        for axis, sine in zip(closed, sines, strict=True):
            family[:, axis] = sine
            if sine:
                sign[half_periods[mode, axis] < 0] *= -1
        yield Expansion(sines, mode, family, sign)
