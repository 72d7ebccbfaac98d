"""Nested sets of modes, factored once, the errors of all of them, and paths limited in time."""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from modalmotion.errors import ParameterError
from modalmotion.mesh.spring_modes import whole_counts
from modalmotion.modes import whole_count
from modalmotion.notes import Note
from modalmotion.numeric.scales import orthonormal, power_of_two
from modalmotion.representation import Floats, Ints
from modalmotion.signature.fit import Basis, Fit, Fitter, largest_sound
from modalmotion.signature.parameters import MOST_MODES, ErrorKind
from modalmotion.template import Template, choose_modes
from modalmotion.template.template import shapes_of

# Numbers in the shapes that are factored at once: 480 MB with their factor.
_MOST_NUMBERS: Final = 30_000_000

# Each spring mode is an eigenvector to solve for.
_MOST_SPRINGS: Final = 400


@dataclass(frozen=True, eq=False)
class NestedModes:
    """All whole sets of modes in one order, up to a largest one: one factorisation serves all.

    Parameters
    ----------
    basis : Basis
        Of the largest set.
    counts : (sets,) int64
        Numbers of modes that split no cosine-sine pair, increasing.
    ends_because : str
        Why there is no larger set; empty if there may be one.
    notes : tuple of Note
        Caveats about the modes.
    """

    basis: Basis
    counts: Ints
    ends_because: str
    notes: tuple[Note, ...] = ()


def nested_modes(template: Template, n_modes: int, grid: tuple[int, ...] | None) -> NestedModes:
    """Factor the first modes of a template, as many of them as it can tell apart.

    Parameters
    ----------
    template : Template
    n_modes : int
        Requested number of the largest set; fewer if the surface, memory or the condition of
        the fit ends the order before.
    grid : tuple of int or None
        Nodes along each axis of a lattice.
    """
    n, ends = most_modes_of(template, n_modes, grid)
    modes, notes = choose_modes(template, n, grid)
    counts = whole_counts(modes)
    shapes, root = shapes_of(modes, template), np.sqrt(template.weights)[:, None]
    Q, R = orthonormal(root * shapes)
    sound = largest_sound(R, counts)
    if sound < n:
        ends = f"{sound} is the largest number of modes that its vertices distinguish"
    whole = Basis(modes, shapes, R, np.ascontiguousarray((root * Q).T), 1.0)
    return NestedModes(whole.first(sound), counts[counts <= sound], ends, notes)


def most_modes_of(
    template: Template, n_modes: int, grid: tuple[int, ...] | None
) -> tuple[int, str]:
    """Largest whole number of modes up to a requested one, and what ends the order, if anything."""
    n_weighted = int((template.weights > 0).sum())
    n_memory = max(_MOST_NUMBERS // template.n_vertices, 7)
    limits = [
        (n_weighted, f"{n_weighted} vertices cannot distinguish more modes"),
        (n_memory, f"the shapes of more than {n_memory} modes exceed the memory set aside"),
        (MOST_MODES, f"a signature has at most {MOST_MODES} modes"),
    ]
    if template.surface is None:
        limits.append((_MOST_SPRINGS, f"at most {_MOST_SPRINGS} spring modes are computed"))
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

    coefficients: Floats
    outside: Floats
    scale: float
    overlaps: Floats | None = None
    cross: Floats | None = None

    def rms(self, counts: Ints) -> Floats:
        """RMS error of the first so many modes over all frames.

        Parameters
        ----------
        counts : (sets,) int64
            0 for the motion itself.

        Returns
        -------
        (sets,) float64, length unit
        """
        by_mode = self._added(self.coefficients, self.cross).sum(axis=0) / len(self.coefficients)
        squares = float(self.outside.mean()) + _dropped(by_mode)[counts]
        return np.asarray(self.scale * np.sqrt(np.maximum(squares, 0.0)))

    def joint_rms(self, counts: Ints, harmonics: "Harmonics") -> Floats:
        """RMS error of the first so many modes, their paths limited to harmonics.

        Returns
        -------
        (sets, harmonics + 1) float64, length unit
            From 0 harmonics to the largest number available.
        """
        f, T = len(self.coefficients), harmonics.functions
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
        return np.asarray(self.scale * np.sqrt(np.maximum(squares, 0.0)))

    def _added(self, c: Floats, cross: Floats | None) -> Floats:
        """Mean square that each mode adds when it is dropped after all later ones, by row.

        Parameters
        ----------
        c, cross : (rows, modes, n) float64

        Returns
        -------
        (rows, modes) float64
        """
        if self.overlaps is None or cross is None:
            return np.asarray((c**2).sum(axis=2))
        # sum_{i,j >= k} G_ij c_i c_j grows by c_k (G_kk c_k + 2 sum_{j > k} G_kj c_j)
        G = np.diag(np.diag(self.overlaps)) + 2.0 * np.triu(self.overlaps, 1)
        rows, m, n_directions = c.shape
        flat = np.ascontiguousarray(c.transpose(1, 0, 2).reshape(m, -1))
        later = (G @ flat).reshape(m, rows, n_directions).transpose(1, 0, 2)
        return np.asarray((c * (later + 2.0 * cross)).sum(axis=2))


def energies_of(fitter: Fitter, fit: Fit, kind: ErrorKind = ErrorKind.WEIGHTED_RMS) -> Energies:
    """Take the energies of a motion from the fit of the largest set: plain, or by weight."""
    basis, is_plain = fit.basis, kind == ErrorKind.RMS
    motion, errors = (
        (each.rms if is_plain else each.weighted_rms) for each in (fit.motion, fit.errors)
    )
    scale = power_of_two(max(float(motion.max()), float(np.abs(fit.amplitudes).max(initial=0.0))))
    # c = R a
    weighted = Energies(basis.triangle @ (fit.amplitudes / scale), (errors / scale) ** 2, scale)
    if not is_plain:
        return weighted
    psi, cross = basis.orthonormal_rows(len(basis.modes)), np.empty_like(weighted.coefficients)
    psi[:, fitter.template.isolated] = 0.0
    n = psi.shape[1] - len(fitter.template.isolated)
    for block in fitter.blocks():
        c = weighted.coefficients[block.frames].transpose(0, 2, 1)
        # r = u - sum_j c_j psi_j
        left = block.u * (block.shape.scale / scale) - c @ psi
        cross[block.frames] = (left @ psi.T).transpose(0, 2, 1) / n
    return replace(weighted, overlaps=psi @ psi.T / n, cross=cross)


def _split(c: Floats, T: Floats) -> tuple[Floats, Floats]:
    """Parts along functions of time, (functions, modes, 3), and beyond, (frames, modes, 3)."""
    flat = np.ascontiguousarray(c.reshape(len(c), -1))
    along = T.T @ flat
    return along.reshape(-1, *c.shape[1:]), (flat - (T @ along)).reshape(c.shape)


def _dropped(squares: Floats) -> Floats:
    """Sum over the rows from each one on, the last first; one more row of zeros."""
    total = np.zeros((len(squares) + 1, *squares.shape[1:]))
    total[:-1] = np.cumsum(squares[::-1], axis=0)[::-1]
    return total


def largest_errors(fitter: Fitter, basis: Basis, energies: Energies, counts: Ints) -> Floats:
    """Largest error of any vertex in any frame for each of several nested sets.

    Unlike the RMS error it may grow with the set, so none can be left out. Each set's
    residual is that of the one before without its further modes.

    Parameters
    ----------
    fitter : Fitter
    basis : Basis
    energies : Energies
        Their coefficients may have been limited to harmonics.
    counts : (sets,) int64
        Increasing.

    Returns
    -------
    (sets,) float64, length unit
    """
    psi, largest = basis.orthonormal_rows(int(counts[-1])), np.zeros(len(counts))
    for block in fitter.blocks():
        left, done = block.u.copy(), 0
        left[:, :, fitter.template.isolated] = 0.0
        psi[:, fitter.template.isolated] = 0.0
        c = energies.coefficients[block.frames] * (energies.scale / block.shape.scale)
        for k, count in enumerate(counts.tolist()):
            left -= c[:, done:count].transpose(0, 2, 1) @ psi[done:count]
            done = count
            far = float(np.sqrt((left**2).sum(axis=1).max())) * block.shape.scale
            largest[k] = max(largest[k], far)
    return largest


MOST_HARMONICS: Final = 64
"""Largest number of harmonics; a path that needs more is given as its frames."""

# Uneven times tell harmonics apart up to this condition.
_LARGEST_CONDITION: Final = 1e3


@dataclass(frozen=True, eq=False)
class Harmonics:
    """Orthonormal functions of the frames, the slow ones first.

    A constant and a straight line in time, then cosine and sine of each harmonic: least
    squares on the times as they are, even or not. The line takes up the distance between the
    ends of a movement that does not come back, so that no cycle is closed by force.

    Parameters
    ----------
    functions : (frames, functions) float64
        Orthonormal columns.
    """

    functions: Floats

    @property
    def most(self) -> int:
        """Largest number of harmonics."""
        return max(int(self.functions.shape[1]) - 2, 0) // 2

    def limited(self, amplitudes: Floats, harmonics: int) -> Floats:
        """Limit paths over time to so many harmonics.

        Parameters
        ----------
        amplitudes : (frames, modes, 3) float64
        harmonics : int

        Returns
        -------
        (frames, modes, 3) float64
        """
        T = np.ascontiguousarray(self.functions[:, : n_functions(harmonics)])
        flat = np.ascontiguousarray(amplitudes.reshape(len(amplitudes), -1))
        return (T @ (T.T @ flat)).reshape(amplitudes.shape)


def n_functions(harmonics: int) -> int:
    """Count the numbers of each amplitude's path: the line's two besides the harmonics'."""
    return 2 * harmonics + 2


def numbers_of_path(n_frames: int, harmonics: int | None) -> int:
    """Count the numbers of each amplitude's path, limited to harmonics or not."""
    return n_frames if harmonics is None else min(n_functions(harmonics), n_frames)


def harmonics_of(n_frames: int, times: Floats | None) -> Harmonics:
    """Make the functions of time of a sequence, as many as its frames tell apart.

    Parameters
    ----------
    n_frames : int
    times : (frames,) float64, s, or None
        Even steps if there are none. One turn of a cycle is one even step longer.
    """
    at = np.arange(n_frames, dtype=np.float64) if times is None else times - times[0]
    if n_frames == 1:
        return Harmonics(np.ones((1, 1)))
    x = at / (at[-1] * n_frames / (n_frames - 1))
    columns = [np.ones(n_frames), x - x.mean()]
    for p in range(1, MOST_HARMONICS + 1):
        if len(columns) + 2 > n_frames:
            break
        pair = [np.cos(2 * np.pi * p * x), np.sin(2 * np.pi * p * x)]
        if np.linalg.cond(np.stack([*columns, *pair], axis=1)) > _LARGEST_CONDITION:
            break
        columns += pair
    functions, R = np.linalg.qr(np.stack(columns, axis=1))
    return Harmonics(functions * np.where(np.diag(R) < 0, -1.0, 1.0))


def limited(fitter: Fitter, fit: Fit) -> Fit:
    """Limit the paths of a fit to the harmonics that parameters ask for, if they do."""
    if fitter.parameters.harmonics is None:
        return fit
    functions = required_harmonics(fitter)
    return fitter.refitted(fit, functions.limited(fit.amplitudes, fitter.parameters.harmonics))


def required_harmonics(fitter: Fitter) -> Harmonics:
    """Functions of time of a sequence, whose frames tell the requested harmonics apart.

    Raises
    ------
    ParameterError
    """
    available = harmonics_of(fitter.sequence.n_frames, fitter.sequence.times)
    harmonics = fitter.parameters.harmonics or 0
    if harmonics > available.most:
        raise ParameterError(
            f"{harmonics} harmonics cannot be distinguished in {fitter.sequence.n_frames} frames.",
            remedy=f"Ask for at most {available.most}, or do not limit the harmonics.",
            details={"harmonics": harmonics, "most": available.most},
        )
    return available
