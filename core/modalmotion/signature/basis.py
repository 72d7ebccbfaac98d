"""Mode shapes on a template, factored once for any number of frames, and their cache."""

from __future__ import annotations

import copy
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from threading import Lock
from typing import Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ModeCountError
from modalmotion.modes import Modes, whole_counts
from modalmotion.numeric.products import inverse_of_triangle, orthonormal, product, triangle_of
from modalmotion.template import ModeChoice, Template, choose_modes
from modalmotion.template.vibration_modes import shapes_of

# Amplitudes lose this factor of the data's precision; beyond it they are not worth giving.
LARGEST_CONDITION: Final = 1e8

# Power iterations that tell a norm to some percent.
_POWERS: Final = 10


@dataclass(frozen=True, eq=False)
class Basis:
    """Mode shapes on a template, factored once for any number of frames.

    Parameters
    ----------
    modes : Modes
    shapes : (vertices, modes) float64
        Phi.
    triangle : (modes, modes) float64
        R of the weighted shapes: |R a| is the weighted RMS of the superposed displacement.
    analysis : (modes, vertices) float64
        Q'W^(1/2): coefficients R a of displacements along orthonormal shapes.
    condition : float
        Of the weighted shapes, 1 for orthogonal ones.
    """

    modes: Modes
    shapes: NDArray[np.float64]
    triangle: NDArray[np.float64]
    analysis: NDArray[np.float64]
    condition: float

    @cached_property
    def projector(self) -> NDArray[np.float64]:
        """Weighted least-squares solution: amplitudes of displacements, (modes, vertices)."""
        return product(inverse_of_triangle(self.triangle), self.analysis)

    @cached_property
    def rows(self) -> NDArray[np.float64]:
        """Shapes with vertices along the memory, (modes, vertices)."""
        return np.ascontiguousarray(self.shapes.T)

    @cached_property
    def columns(self) -> NDArray[np.float64]:
        """Projector with modes along the memory, filled with zeros to a multiple of eight."""
        m, n = self.projector.shape
        columns = np.zeros((n, -(-m // 8) * 8))
        columns[:, :m] = self.projector.T
        return columns

    def orthonormal_rows(self, n_modes: int) -> NDArray[np.float64]:
        """Shapes Psi = Phi R^-1 of the first modes, orthonormal by weight, (modes, vertices)."""
        inverse = inverse_of_triangle(np.ascontiguousarray(self.triangle[:n_modes, :n_modes]))
        return product(np.ascontiguousarray(inverse.T), self.rows[:n_modes])


def make_basis(template: Template, modes: Modes) -> Basis:
    """Evaluate and factor modes on a template.

    Raises
    ------
    ModeCountError
        If the weighted vertices cannot resolve that many modes.
    """
    return factored(modes, shapes_of(modes, template), template.weights)


def factored(modes: Modes, shapes: NDArray[np.float64], weights: NDArray[np.float64]) -> Basis:
    """Factor shapes with weights.

    Raises
    ------
    ModeCountError
        If there are fewer weighted vertices than modes, or they cannot distinguish them.
    """
    n_weighted = int((weights > 0).sum())
    root = np.sqrt(weights)[:, None]
    if len(modes) > n_weighted:
        R = triangle_of(root * shapes[:, :n_weighted])
        raise _too_many(
            modes, R, f"{len(modes)} modes cannot be distinguished on {n_weighted} vertices."
        )
    weighted = root * shapes
    R = triangle_of(weighted)
    condition = float(np.linalg.cond(R))
    if not condition <= LARGEST_CONDITION:
        raise _too_many(
            modes,
            R,
            f"{len(modes)} modes have the condition {condition:.1e} on this surface, above "
            f"{LARGEST_CONDITION:.0e}: the amplitudes would be noise.",
            condition=condition,
        )
    Q, R = orthonormal(weighted, R, condition)
    return Basis(modes, shapes, R, np.ascontiguousarray((root * Q).T), condition)


def _too_many(
    modes: Modes, R: NDArray[np.float64], message: str, **details: float
) -> ModeCountError:
    """Error that names the largest number of modes that passes, in whole pairs."""
    counts = whole_counts(modes)
    counts = counts[counts <= len(R)]
    most, _ = largest_sound(R[: counts[-1], : counts[-1]], counts)
    return ModeCountError(
        message,
        remedy=f"Ask for at most {most} modes, or send a finer mesh.",
        details={"modes": len(modes), "most": most, **details},
    )


def largest_sound(R: NDArray[np.float64], counts: NDArray[np.int64]) -> tuple[int, float]:
    """Largest whole set whose amplitudes are worth giving, and the condition of its fit.

    The condition only grows with the set: near the one that a cheap estimate finds, singular values
    decide.

    Parameters
    ----------
    R : (modes, modes) float64
        Triangle of the weighted shapes.
    counts : (n,) int64
        Modes of each set, increasing; the last one is all.

    Returns
    -------
    int, float
        Modes and condition.

    Raises
    ------
    ModeCountError
        If not even those of the smallest set are.
    """
    condition = _condition(R)
    if condition <= LARGEST_CONDITION:
        return int(counts[-1]), condition
    low = _about_sound(R, counts)
    condition = _condition(R[: counts[low], : counts[low]])
    while low > 0 and not condition <= LARGEST_CONDITION:
        low -= 1
        condition = _condition(R[: counts[low], : counts[low]])
    while (larger := _condition(R[: counts[low + 1], : counts[low + 1]])) <= LARGEST_CONDITION:
        low, condition = low + 1, larger
    count = int(counts[low])
    if not condition <= LARGEST_CONDITION:
        raise ModeCountError(
            f"{count} modes have the condition {condition:.1e} on this surface.",
            remedy="Send a finer mesh.",
            details={"modes": count, "condition": condition},
        )
    return count, condition


def _about_sound(R: NDArray[np.float64], counts: NDArray[np.int64]) -> int:
    """Place of about the largest set that is sound: not the last one.

    |R| |R^-1| by power iterations; the inverses of nested triangles are nested like them.
    """
    diagonal = np.abs(np.diag(R))
    with np.errstate(divide="ignore"):
        ratios = np.maximum.accumulate(diagonal) / np.minimum.accumulate(diagonal)
    high = int(np.searchsorted(counts, int((ratios <= LARGEST_CONDITION).sum()), "right"))
    low, high = 0, min(high, len(counts) - 1)
    R = np.ascontiguousarray(R[: counts[high - 1], : counts[high - 1]])
    matrices = R, inverse_of_triangle(R)
    while high - low > 1:
        middle = (low + high) // 2
        n = int(counts[middle])
        condition = 1.0
        for A in matrices:
            x = np.ones((n, 1))
            for _ in range(_POWERS):
                x = product(A[:n, :n].T, product(A[:n, :n], x / np.linalg.norm(x)))
            condition *= float(np.sqrt(np.linalg.norm(x)))
        low, high = (middle, high) if condition <= LARGEST_CONDITION else (low, middle)
    return low


def _condition(R: NDArray[np.float64]) -> float:
    # A cheap lower bound spares most singular values.
    diagonal = np.abs(np.diag(R))
    least = float(diagonal.min())
    if not least > 0 or float(diagonal.max()) / least > LARGEST_CONDITION:
        return np.inf
    return float(np.linalg.cond(R))


_Value = TypeVar("_Value")

# A basis keeps shapes and projector, both also laid out the other way.
_LAYOUTS: Final = 4


class TemplateCache:
    """The last templates and factored modes, for threads that share them.

    Parameters
    ----------
    n_templates, n_bases : int
        Largest number of each; the longest unused go first. A template of 10,000 vertices
        takes 1 MB, its factored modes 0.3 MB for each mode.
    most_bytes : int
        Memory for each of the two; anything larger is not stored.
    """

    def __init__(
        self, n_templates: int = 64, n_bases: int = 64, most_bytes: int = 256_000_000
    ) -> None:
        self._templates: _Recent[Template] = _Recent(n_templates, most_bytes)
        self._bases: _Recent[tuple[ModeChoice, Basis]] = _Recent(n_bases, most_bytes)
        self._name = ""

    def part(self, name: str) -> TemplateCache:
        """Return a cache that shares the room of this one, and none of what other parts hold."""
        part = copy.copy(self)
        part._name = f"{self._name}{name}\n"
        return part

    def named(self, template_id: str, load: Callable[[], Template]) -> Template:
        """Return the template of an id, loaded if it is not here."""
        key = f"{self._name}{template_id}"
        template = self._templates.get(key)
        if template is None:
            template = load()
            self._templates.put(key, template, _size(template))
        return template

    def basis(
        self,
        template: Template,
        n_modes: int,
        grid: tuple[int, ...] | None = None,
        *,
        split_pairs: bool = False,
    ) -> tuple[ModeChoice, Basis]:
        """Choose and factor the modes of a template: see `choose_modes` and `make_basis`."""
        key = f"{self._name}{template.id} {n_modes} {grid} {split_pairs}"
        entry = self._bases.get(key)
        if entry is None:
            choice = choose_modes(template, n_modes, grid, split_pairs=split_pairs)
            entry = (choice, make_basis(template, choice.modes))
            self._bases.put(key, entry, _LAYOUTS * entry[1].shapes.nbytes)
        return entry


def _size(template: Template) -> int:
    arrays = (template.coordinates, template.weights, template.vertices, template.faces)
    return sum(array.nbytes for array in arrays)


class _Recent(Generic[_Value]):
    """A mapping that forgets what was not used for longest."""

    def __init__(self, n_most: int, most_bytes: int) -> None:
        self._n_most = n_most
        self._most_bytes = most_bytes
        self._n_bytes = 0
        self._values: OrderedDict[str, tuple[_Value, int]] = OrderedDict()
        self._lock = Lock()

    def get(self, key: str) -> _Value | None:
        with self._lock:
            if key not in self._values:
                return None
            self._values.move_to_end(key)
            return self._values[key][0]

    def put(self, key: str, value: _Value, n_bytes: int) -> None:
        if n_bytes > self._most_bytes:
            return
        with self._lock:
            if key in self._values:
                # Another thread was quicker with the same.
                return
            self._values[key] = (value, n_bytes)
            self._n_bytes += n_bytes
            while len(self._values) > self._n_most or self._n_bytes > self._most_bytes:
                self._n_bytes -= self._values.popitem(last=False)[1][1]
