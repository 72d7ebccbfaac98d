"""Modes as sums of products of one function per axis, and their values along each axis."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import LimitError, ModeCountError, ParameterError, ShapeError
from modalmotion.modes.topology import CLOSED, Topology
from modalmotion.modes.trigonometry import circle_cosines, cos_pi, exact_products
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


# Beyond this many parts of a turn single cosines cost less memory than all of a circle.
_LARGEST_CIRCLE = 1 << 18
# Up to this many turns the look-up takes the phase modulo a turn by itself, faster.
_FEW_TURNS = 8


@dataclass(frozen=True, eq=False)
class Factors:
    """Modes of a lattice as sums of products of one function per axis.

    Parameters
    ----------
    functions : tuple of (functions, nodes) float64
        For each axis its distinct functions at the nodes along it.
    separable : Separable
        Rule by which they multiply and add up to modes.
    coefficients : (terms,) float64
        Factor of each product: the sign of the term times the scale of the mode.
    """

    functions: tuple[NDArray[np.float64], ...]
    separable: Separable
    coefficients: NDArray[np.float64]

    def shapes(self, out: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """Multiply out: every mode at every node.

        Parameters
        ----------
        out : (nodes, modes) float64, optional
            Receives the shapes; one mode after the other in memory.

        Returns
        -------
        (nodes, modes) float64
            One mode after the other in memory.

        Raises
        ------
        ShapeError
            If `out` is another kind of array.
        """
        by_mode = self._by_mode(out)
        grid = by_mode.reshape(self.n_modes, self.functions[0].shape[1], -1)
        first, *others = self.separable.sums
        rows, rest = self._rows(first.term), self._rest(first.term)
        np.multiply(rows[:, :, None], rest[:, None, :], out=grid)
        for terms in others:
            rows, rest = self._rows(terms.term), self._rest(terms.term)
            for mode, row, others_along in zip(terms.mode, rows, rest, strict=True):
                grid[mode] += row[:, None] * others_along
        return by_mode.T

    def shapes_along(self) -> NDArray[np.float64]:
        """Multiply node by node, for functions at places of the same nodes on each axis.

        Returns
        -------
        (nodes, modes) float64
            With the same bits as the rows of `shapes`.
        """
        by_mode = np.zeros((self.n_modes, self.functions[0].shape[1]))
        for terms in self.separable.sums:
            rest = np.ones(1)
            for axis, f in enumerate(self.functions[1:], start=1):
                rest = rest * f[self.separable.columns[terms.term, axis]]
            by_mode[terms.mode] += self._rows(terms.term) * rest
        return by_mode.T

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return len(self.separable.sums[0].mode)

    @property
    def n_nodes(self) -> int:
        """Number of nodes of the lattice."""
        return math.prod(f.shape[1] for f in self.functions)

    def _rows(self, term: NDArray[np.int64]) -> NDArray[np.float64]:
        """Factors of terms along the first axis, with their coefficients: (terms, nodes)."""
        rows: NDArray[np.float64] = self.functions[0][self.separable.columns[term, 0]]
        rows *= self.coefficients[term, None]
        return rows

    def _rest(self, term: NDArray[np.int64]) -> NDArray[np.float64]:
        """Products of the factors along the other axes, row by row: (terms, nodes)."""
        rest = np.ones((len(term), 1))
        for axis, f in enumerate(self.functions[1:], start=1):
            along = f[self.separable.columns[term, axis]]
            if axis == 1:
                rest = along
            else:
                rest = (rest[:, :, None] * along[:, None, :]).reshape(len(term), -1)
        return rest

    def _by_mode(self, out: NDArray[np.float64] | None) -> NDArray[np.float64]:
        if out is None:
            return np.empty((self.n_modes, self.n_nodes))
        shape = (self.n_nodes, self.n_modes)
        if out.shape != shape or out.dtype != np.float64 or not out.flags.f_contiguous:
            raise ShapeError(
                f"'out' cannot receive the shapes: {out.dtype} of the shape {out.shape} came, and "
                f"float64 of the shape {shape} is needed, one mode after the other in memory.",
                remedy="Give np.empty(shape, order='F'), or none.",
                details={"array": "out", "shape": list(out.shape)},
            )
        return out.T


def functions_on(separable: Separable, shape: tuple[int, ...]) -> tuple[NDArray[np.float64], ...]:
    """Evaluate the functions along each axis at every node of a lattice.

    Parameters
    ----------
    separable : Separable
    shape : tuple of int
        Nodes along each axis.

    Returns
    -------
    tuple of (functions, nodes) float64
    """
    turns = [_turn(d, n) for (_, d), n in zip(separable.waves, shape, strict=True)]
    finest = max(turns)
    if finest > _LARGEST_CIRCLE:
        return tuple(functions_at(separable, axis, n, np.arange(n)) for axis, n in enumerate(shape))
    # One circle serves all axes when it holds the angles of each.
    shared = circle_cosines(finest) if all(finest % turn == 0 for turn in turns) else None
    functions = []
    for axis, ((m, d), n) in enumerate(zip(separable.waves, shape, strict=True)):
        circle = circle_cosines(turns[axis]) if shared is None else shared
        parts = len(circle)
        if d == 1:
            phase = m * np.arange(parts // n, parts + 1, parts // n)
        else:
            step = parts // (d * n)
            phase = m * np.arange(step, 2 * n * step, 2 * step)
        if separable.has_sine[axis]:
            phase -= separable.is_sine[axis] * (parts // 4)
        if separable.largest[axis] > _FEW_TURNS:
            phase %= parts
        functions.append(circle.take(phase, mode="wrap"))
    return tuple(functions)


def functions_at(
    separable: Separable, axis: int, n: int, nodes: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Evaluate the functions along one axis at some of its nodes, however many it has.

    Parameters
    ----------
    separable : Separable
    axis : int
    n : int
        Nodes along the axis.
    nodes : (nodes,) int64
        From 0 to n - 1.

    Returns
    -------
    (functions, nodes) float64
        With the same bits as `functions_on`.
    """
    m, d = separable.waves[axis]
    turn = _turn(d, n)
    if d == 1:
        # cos(2 pi m n / N), n = 1..N
        phase = exact_products(m[:, 0], nodes + 1, n) * (turn // n)
    else:
        # cos(2 pi m (2n - 1) / dN), n = 1..N
        phase = exact_products(m[:, 0], 2 * nodes + 1, turn)
    return cos_pi(phase - separable.is_sine[axis] * (turn // 4), turn // 2)


def places_along(
    shape: tuple[int, ...], nodes: NDArray[np.int64] | list[int]
) -> list[NDArray[np.int64]]:
    """Find the place of nodes along each axis.

    Parameters
    ----------
    shape : tuple of int
    nodes : (nodes,) int64
        Numbered row by row.

    Returns
    -------
    list of (nodes,) int64

    Raises
    ------
    ShapeError
        If they are not a list of integers, or one of them is not a node.
    LimitError
        If 64 bits do not number all nodes.
    """
    n_nodes = math.prod(shape)
    if n_nodes >= 2**63:
        raise LimitError(
            f"A lattice of {shape} nodes has more than 64 bits number.",
            remedy="Evaluate the axes one by one, as curves.",
            limit="nodes",
        )
    numbers = np.asarray(nodes)
    if numbers.ndim != 1 or (numbers.size and numbers.dtype.kind not in "iu"):
        raise ShapeError(
            f"Nodes are a list of integers, not {numbers.dtype} of the shape {numbers.shape}.",
            remedy="Number them row by row: node = row * N' + column.",
        )
    bad = np.flatnonzero((numbers < 0) | (numbers >= n_nodes))
    if bad.size:
        raise ShapeError(
            f"There is no node {numbers[bad[0]]} on a lattice of {n_nodes}.",
            remedy=f"Number nodes from 0 to {n_nodes - 1}.",
            vertex=int(numbers[bad[0]]),
        )
    along = np.unravel_index(numbers.astype(np.int64), shape)
    return [place.astype(np.int64) for place in along]


def _turn(d: int, n: int) -> int:
    """Parts of a turn in which every phase along an axis of n nodes, and a quarter, is whole."""
    return n * 4 // math.gcd(n, 4) if d == 1 else d * n
