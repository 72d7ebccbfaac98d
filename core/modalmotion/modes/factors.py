"""Values of modes along each axis of a lattice: the factors of separable shapes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import LimitError, ShapeError
from modalmotion.modes.separable import Separable
from modalmotion.modes.trigonometry import circle_cosines, cos_pi, exact_products

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
