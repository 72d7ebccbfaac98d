"""Nested sets of modes, factored together once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.choice.parameters import MOST_MODES
from modalmotion.fit.basis import Basis, largest_sound
from modalmotion.modes import Modes, whole_count, whole_counts
from modalmotion.numeric.qr import orthonormal, triangle_of
from modalmotion.template import Template, choose_modes
from modalmotion.template.vibration_modes import shapes_of

# Numbers in the shapes that are factored at once: 480 MB with their factor.
_MOST_NUMBERS: Final = 30_000_000


# Each spring mode is an eigenvector to solve for.
_MOST_SPRINGS: Final = 400


@dataclass(frozen=True, eq=False)
class Ladder:
    """All whole sets of modes in one order, up to a largest one.

    The first k columns of a QR factorisation are that of the first k shapes, so one
    factorisation serves every set.

    Parameters
    ----------
    basis : Basis
        Of the largest set.
    counts : (sets,) int64
        Numbers of modes that split no cosine-sine pair, increasing.
    ends_because : str
        Why there is no larger set; empty if there may be one.
    notes : tuple of str
        Caveats about the modes.
    """

    basis: Basis
    counts: NDArray[np.int64]
    ends_because: str
    notes: tuple[str, ...] = ()

    @cached_property
    def noise_shares(self) -> NDArray[np.float64]:
        """Expected squared coefficient of each mode in independent noise of variance 1.

        Returns
        -------
        (modes,) float64
            Near 1 / vertices each.
        """
        # c = Q'W^(1/2) e, so E c_j^2 is the squared length of row j.
        rows = self.basis.analysis
        shares: NDArray[np.float64] = np.einsum("jn,jn->j", rows, rows)
        return shares

    def basis_of(self, count: int) -> Basis:
        """First modes of the order, factored."""
        whole = self.basis
        R = np.ascontiguousarray(whole.triangle[:count, :count])
        shapes = np.ascontiguousarray(whole.shapes[:, :count])
        condition = float(np.linalg.cond(R))
        return Basis(self.modes(count), shapes, R, whole.analysis[:count], condition)

    def modes(self, count: int) -> Modes:
        """First modes of the order."""
        return self.basis.modes.take(np.arange(count))


def ladder_of(template: Template, n_modes: int, grid: tuple[int, ...] | None = None) -> Ladder:
    """Factor the first modes of a template, as many of them as it can tell apart.

    Parameters
    ----------
    template : Template
    n_modes : int
        Requested number of the largest set; fewer if the surface, memory or the condition of
        the fit ends the order before.
    grid : tuple of int, optional
        Nodes along each axis of a lattice.
    """
    n, ends = most_modes_of(template, n_modes, grid)
    choice = choose_modes(template, n, grid)
    modes = choice.modes
    shapes = shapes_of(modes, template)
    root = np.sqrt(template.weights)[:, None]
    weighted = root * shapes
    R = triangle_of(weighted)
    counts = whole_counts(modes)
    sound, condition = largest_sound(R, counts)
    if sound < n:
        ends = f"{sound} modes are the most that its vertices tell apart"
        weighted, R = weighted[:, :sound], np.ascontiguousarray(R[:sound, :sound])
        shapes = np.ascontiguousarray(shapes[:, :sound])
        modes, counts = modes.take(np.arange(sound)), counts[counts <= sound]
    Q, R = orthonormal(weighted, R, condition)
    basis = Basis(modes, shapes, R, np.ascontiguousarray((root * Q).T), condition)
    return Ladder(basis, counts, ends, choice.notes)


def most_modes_of(
    template: Template, n_modes: int, grid: tuple[int, ...] | None
) -> tuple[int, str]:
    """Largest whole number of modes up to a requested one, and what ends the order, if anything."""
    n_weighted = int((template.weights > 0).sum())
    n_memory = max(_MOST_NUMBERS // template.n_vertices, 7)
    limits = [
        (n_weighted, f"{n_weighted} vertices tell no more modes apart"),
        (n_memory, f"the shapes of more than {n_memory} modes exceed the memory set aside"),
        (MOST_MODES, f"a signature has at most {MOST_MODES} modes"),
    ]
    if template.surface is None:
        limits.append((_MOST_SPRINGS, f"no more than {_MOST_SPRINGS} spring modes are solved for"))
    most, reason = min(limits, key=lambda limit: limit[0])
    if n_modes < most:
        most, reason = n_modes, ""
    if template.surface is not None:
        if grid is not None:
            most = min(most, math.prod(grid))
        whole = whole_count(template.surface, most, grid)
        # Not beyond the end of the order.
        most = whole if whole == most or not reason else most - 1
    return most, reason
