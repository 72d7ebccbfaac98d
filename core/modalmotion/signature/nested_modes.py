"""Nested sets of modes, factored once, and the errors of all of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes import Modes, whole_count, whole_counts
from modalmotion.numeric.products import orthonormal, power_of_two, product, triangle_of
from modalmotion.signature.basis import Basis, largest_sound
from modalmotion.signature.fit import Fit
from modalmotion.signature.fitter import Fitter
from modalmotion.signature.model import Harmonics, n_functions
from modalmotion.signature.parameters import MOST_MODES
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


@dataclass(frozen=True, eq=False)
class Energies:
    """Mean squares of a motion by mode and by function of time.

    With W^(1/2) Phi = Q R and c = Q'W^(1/2) u = R a, the residual of the first k modes is
    |r_k|^2 = |r|^2 + sum_{j >= k} c_j^2, r that of the largest set: sums of squares that are
    dropped, so small errors do not come from differences of large ones.

    The fit is orthogonal by weight alone. Where all vertices count alike, with G = Psi'Psi / N
    and b = Psi'r / N, Psi = Phi R^-1, what is dropped takes c'(G c + 2 b) with it instead.

    Parameters
    ----------
    coefficients : (frames, modes, n) float64, in units of the scale
        c of the largest set.
    outside : (frames,) float64, in units of the scale squared
        Mean square residual of the largest set.
    scale : float, length unit
        A power of two: squares neither overflow nor vanish.
    overlaps : (modes, modes) float64 or None
        G; None by weight, where it is the unit matrix.
    cross : (frames, modes, n) float64, in units of the scale, or None
        b; None by weight, where it is zero.
    """

    coefficients: NDArray[np.float64]
    outside: NDArray[np.float64]
    scale: float
    overlaps: NDArray[np.float64] | None = None
    cross: NDArray[np.float64] | None = None

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.coefficients)

    def rms(self, counts: NDArray[np.int64]) -> NDArray[np.float64]:
        """RMS error of the first so many modes over all frames.

        Parameters
        ----------
        counts : (sets,) int64
            0 for the motion itself.

        Returns
        -------
        (sets,) float64, length unit
        """
        by_mode = self._added(self.coefficients, self.cross).sum(axis=0) / self.n_frames
        squares = float(self.outside.mean()) + _dropped(by_mode)[counts]
        rms: NDArray[np.float64] = self.scale * np.sqrt(np.maximum(squares, 0.0))
        return rms

    def worst_frame_rms(self, counts: NDArray[np.int64]) -> NDArray[np.float64]:
        """RMS error of the worst frame: no maximum over the vertices is smaller.

        Returns
        -------
        (sets,) float64, length unit
        """
        squares = self.outside + _dropped(self._added(self.coefficients, self.cross).T)[counts]
        worst: NDArray[np.float64] = self.scale * np.sqrt(squares.max(axis=1))
        return worst

    def joint_rms(self, counts: NDArray[np.int64], harmonics: Harmonics) -> NDArray[np.float64]:
        """RMS error of the first so many modes, their paths limited to harmonics.

        Returns
        -------
        (sets, harmonics + 1) float64, length unit
            From 0 harmonics to the largest number available.
        """
        f = self.n_frames
        T = harmonics.functions
        along, beyond = _split(self.coefficients, T)
        cross_along, cross_beyond = (None, None) if self.cross is None else _split(self.cross, T)
        by_function = self._added(along, cross_along) / f
        left = self._added(beyond, cross_beyond).sum(axis=0) / f
        # Modes in the set lose the later functions of time.
        n = [min(n_functions(h), T.shape[1]) for h in range(harmonics.most + 1)]
        lost = left + _dropped(by_function)[n]
        late = np.concatenate([np.zeros((len(n), 1)), np.cumsum(lost, axis=1)], axis=1)
        by_mode = by_function.sum(axis=0) + left
        squares = float(self.outside.mean()) + _dropped(by_mode)[counts][:, None] + late.T[counts]
        joint: NDArray[np.float64] = self.scale * np.sqrt(np.maximum(squares, 0.0))
        return joint

    def _added(
        self, c: NDArray[np.float64], cross: NDArray[np.float64] | None
    ) -> NDArray[np.float64]:
        """Mean square that each mode adds when it is dropped after all later ones, by row.

        Parameters
        ----------
        c, cross : (rows, modes, n) float64

        Returns
        -------
        (rows, modes) float64
        """
        if self.overlaps is None or cross is None:
            squares: NDArray[np.float64] = (c**2).sum(axis=2)
            return squares
        # sum_{i,j >= k} G_ij c_i c_j grows by c_k (G_kk c_k + 2 sum_{j > k} G_kj c_j)
        G = np.diag(np.diag(self.overlaps)) + 2.0 * np.triu(self.overlaps, 1)
        rows, m, n_directions = c.shape
        flat = np.ascontiguousarray(c.transpose(1, 0, 2).reshape(m, -1))
        later = product(G, flat).reshape(m, rows, n_directions).transpose(1, 0, 2)
        added: NDArray[np.float64] = (c * (later + 2.0 * cross)).sum(axis=2)
        return added


def energies_of(basis: Basis, fit: Fit) -> Energies:
    """Take the energies by weight of a motion from the fit of the largest set."""
    f, m, n_directions = fit.amplitudes.shape
    largest = max(
        float(fit.weighted_motion_rms.max()), float(np.abs(fit.amplitudes).max(initial=0.0))
    )
    scale = power_of_two(largest)
    a = (fit.amplitudes / scale).transpose(0, 2, 1).reshape(n_directions * f, m)
    # c = R a
    c = product(np.ascontiguousarray(a), np.ascontiguousarray(basis.triangle.T))
    return Energies(
        coefficients=np.ascontiguousarray(c.reshape(f, n_directions, m).transpose(0, 2, 1)),
        outside=(fit.errors.weighted_rms / scale) ** 2,
        scale=scale,
    )


def _split(
    c: NDArray[np.float64], T: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Parts along functions of time, (functions, modes, 3), and beyond, (frames, modes, 3)."""
    flat = np.ascontiguousarray(c.reshape(len(c), -1))
    along = product(np.ascontiguousarray(T.T), flat)
    return along.reshape(-1, *c.shape[1:]), (flat - product(T, along)).reshape(c.shape)


def _dropped(squares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum over the rows from each one on, the last first; one more row of zeros."""
    total = np.zeros((len(squares) + 1, *squares.shape[1:]))
    total[:-1] = np.cumsum(squares[::-1], axis=0)[::-1]
    return total


def plain_energies_of(fitter: Fitter, basis: Basis, fit: Fit) -> Energies:
    """Take the plain energies of a motion from the fit of the largest set.

    Parameters
    ----------
    fitter : Fitter
    basis : Basis
        Of the largest set, in the order of the fit's amplitudes.
    fit : Fit
    """
    weighted = energies_of(basis, fit)
    # A scale of its own: vertices in no triangle may lie anywhere.
    largest = max(float(fit.motion_rms.max()), float(np.abs(fit.amplitudes).max(initial=0.0)))
    scale = power_of_two(largest)
    m, n = basis.projector.shape
    psi = basis.orthonormal_rows(m)
    columns = np.ascontiguousarray(psi.T)
    cross = np.empty_like(weighted.coefficients)
    for block in fitter.displacements.blocks():
        u, loose_u = fitter.in_components(block)
        c = weighted.coefficients[block.frames]
        loose_u = loose_u - columns[block.loose] @ (c * weighted.scale)
        f, n_directions, _ = u.shape
        c = c * (weighted.scale / block.shape.scale)
        # r = u - sum_j c_j psi_j
        rows = u.reshape(n_directions * f, n)
        flat = np.ascontiguousarray(c.transpose(0, 2, 1)).reshape(n_directions * f, m)
        rows -= product(flat, psi)
        rows *= block.shape.scale / scale
        u[:, :, block.loose] = loose_u.transpose(0, 2, 1) / scale
        dots = product(rows, columns).reshape(f, n_directions, m)
        cross[block.frames] = dots.transpose(0, 2, 1) / n
    return Energies(
        coefficients=weighted.coefficients * (weighted.scale / scale),
        outside=(fit.errors.rms / scale) ** 2,
        scale=scale,
        overlaps=product(psi, columns) / n,
        cross=cross,
    )
