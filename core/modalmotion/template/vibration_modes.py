"""The modes of one surface: their labels, frequencies and shapes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.errors import ModeCountError, ParameterError
from modalmotion.mesh import connectivity_of
from modalmotion.mesh.spring_modes import spring_modes
from modalmotion.modes import ModeLabel, Modes, ModeSet, lowest_modes, whole_count, whole_counts
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.order import modes_named
from modalmotion.modes.topology import MESH
from modalmotion.numeric.scales import power_of_two
from modalmotion.representation import shown
from modalmotion.template.template import Template

FASTEST_WAVE: Final = 1e100
"""Largest wave speed, length unit per s: beyond it the energy, which contains its square, may
overflow."""


def require_wave_speed(wave_speed: float) -> None:
    """Refuse what no waves have.

    Raises
    ------
    ParameterError
    """
    if not 0 < wave_speed <= FASTEST_WAVE:
        raise ParameterError(
            f"The wave speed is {wave_speed}.",
            remedy=f"Use a speed above zero, at most {FASTEST_WAVE:g}.",
        )


def frequencies_of(
    modes: Modes, template: Template, wave_speed: float = 1.0
) -> NDArray[np.float64]:
    """Angular frequencies w = c k of modes on a template's surface.

    Parameters
    ----------
    modes : Modes
    template : Template
    wave_speed : float, length unit per s
        c.

    Returns
    -------
    (modes,) float64, rad per s

    Raises
    ------
    ParameterError
        If no waves have this speed, or a frequency is beyond the largest number.
    """
    require_wave_speed(wave_speed)
    with np.errstate(over="ignore"):
        frequencies = modes.frequencies_on(template, wave_speed)
    if not np.isfinite(frequencies).all():
        raise ParameterError(
            f"Waves of {wave_speed:g} length units per s on a surface of the lengths "
            f"{', '.join(f'{length:.3g}' for length in template.lengths)} have frequencies beyond "
            "the largest number.",
            remedy="State lengths in a smaller unit, or a smaller wave speed.",
        )
    return frequencies


# Extents of the surface; farther vertices are looked for from here, where squares are usual.
_FARTHEST: Final = 1e6


def nearest_in_use(vertices: NDArray[np.float64], isolated: NDArray[np.int64]) -> NDArray[np.int64]:
    """Vertex of the surface nearest to each isolated one.

    Parameters
    ----------
    vertices : (vertices, 3) float64, length unit
        Isolated ones may lie anywhere.
    isolated : (n,) int64

    Returns
    -------
    (n,) int64
        Itself where no vertex is in use.
    """
    used = np.delete(np.arange(len(vertices)), isolated)
    if not len(used):
        return isolated
    corner = vertices[used[0]]
    surface = vertices[used] - corner
    scale = power_of_two(float(np.abs(surface).max(initial=0.0)))
    with np.errstate(over="ignore"):
        apart = np.clip((vertices[isolated] - corner) / scale, -_FARTHEST, _FARTHEST)
    nearest: NDArray[np.int64] = used[scipy.spatial.cKDTree(surface / scale).query(apart)[1]]
    return nearest


def shapes_of(modes: Modes, template: Template) -> NDArray[np.float64]:
    """Mode shapes at all vertices of a template, isolated ones as their nearest in use.

    Returns
    -------
    (vertices, modes) float64
    """
    shapes = modes.shapes_on(template)
    if len(template.isolated):
        shapes = shapes.copy()
        shapes[template.isolated] = shapes[nearest_in_use(template.vertices, template.isolated)]
    return shapes


@dataclass(frozen=True, eq=False)
class ModeChoice:
    """The modes that answer a request for a number of them.

    Parameters
    ----------
    modes : Modes
        In closed form where the surface has natural coordinates.
    notes : tuple of str
        Why there are more than requested, the cost of a split pair, or that they belong to
        one mesh only.
    """

    modes: Modes
    notes: tuple[str, ...]


def choose_modes(
    template: Template,
    n_modes: int,
    grid: tuple[int, ...] | None = None,
    *,
    split_pairs: bool = False,
) -> ModeChoice:
    """Lowest modes of a template, rounded up so that no cosine-sine pair is split.

    Parameters
    ----------
    template : Template
    n_modes : int
    grid : tuple of int, optional
        Nodes along each axis of a lattice, which has no modes beyond its own number.
    split_pairs : bool
        Whether to take the number literally.

    Raises
    ------
    ModeCountError
        If there are not that many.
    """
    if template.surface is None:
        springs = spring_modes(template.faces, template.n_vertices, n_modes)
        springs = springs.at(template.representatives)
        note = (
            "These are the spring modes of this mesh; their amplitudes compare with those of "
            "meshes of the same connectivity only."
        )
        return ModeChoice(springs, (note,))
    n_whole = whole_count(template.surface, n_modes, grid)
    chosen = lowest_modes(template.surface, n_modes if split_pairs else n_whole, grid)
    if n_whole == n_modes:
        return ModeChoice(chosen, ())
    if split_pairs:
        note = (
            f"Mode {chosen.labels[-1]} was fitted without its sine: its amplitudes depend on where "
            "theta is zero, and compare only with those of surfaces whose zero is the same."
        )
        return ModeChoice(chosen, (note,))
    note = (
        f"{n_modes} modes would split a cosine-sine pair; {n_whole} were fitted "
        f"({3 * n_whole} amplitudes a frame)."
    )
    return ModeChoice(chosen, (note,))


@shown("surface", "labels", "angular_frequencies", "shapes")
@dataclass(frozen=True, eq=False)
class VibrationModes:
    """Some modes of one surface, in order.

    Parameters
    ----------
    surface : str
        Name of the topology, or "mesh" for the spring modes of one mesh.
    labels : tuple of ModeLabel
    angular_frequencies : (modes,) float64, `frequency_unit`
    shapes : (vertices, modes) float64
        Phi, each column with mean square 1.
    frequency_unit : str
        With its assumptions: the speed of waves, or stiffness and mass.
    notes : tuple of str
    """

    surface: str
    labels: tuple[ModeLabel, ...]
    angular_frequencies: NDArray[np.float64]
    shapes: NDArray[np.float64]
    frequency_unit: str
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.labels)


def lattice_modes(lattice: Lattice, n_modes: int) -> VibrationModes:
    """Lowest modes of a lattice, rounded up so that no pair is split; frequencies by (7).

    Raises
    ------
    ModeCountError
        If it does not have that many.
    """
    return _of_lattice(lattice, lattice.whole_modes(n_modes))


def lattice_modes_named(lattice: Lattice, labels: list[ModeLabel]) -> VibrationModes:
    """Modes of a lattice by their labels.

    Raises
    ------
    ParameterError
        If a label is not one of its modes.
    """
    return _of_lattice(lattice, modes_named(lattice.topology, labels, lattice.shape))


def surface_modes(template: Template, n_modes: int, wave_speed: float = 1.0) -> VibrationModes:
    """Lowest modes of a template, rounded up so that no pair is split.

    Parameters
    ----------
    template : Template
    n_modes : int
    wave_speed : float, length unit per s
        c of the frequencies w = c k.

    Raises
    ------
    ModeCountError
        If there are more modes than vertices.
    ParameterError
        If no waves have this speed, or a frequency is beyond the largest number.
    """
    choice = choose_modes(template, min(n_modes, template.n_vertices + 1))
    if len(choice.modes) > template.n_vertices:
        counts = whole_counts(choice.modes)
        most = int(counts[counts <= template.n_vertices].max(initial=1))
        raise ModeCountError(
            f"{n_modes} modes were requested on {template.n_vertices} vertices.",
            remedy=f"Ask for at most {most} modes.",
            details={"modes": n_modes, "most": most},
        )
    return _of_template(template, choice.modes, wave_speed, choice.notes)


def surface_modes_named(
    template: Template, labels: list[ModeLabel], wave_speed: float = 1.0
) -> VibrationModes:
    """Modes of a template by their labels.

    Raises
    ------
    ParameterError
        If a label is not one of its modes, or its waves are too short for the mesh to show.
    """
    if template.surface is not None:
        modes = modes_named(template.surface, labels)
        _require_shown(template, modes)
        return _of_template(template, modes, wave_speed, ())
    ranks = [label.wavenumbers[0] for label in labels if label.part == "spring"]
    if len(ranks) != len(labels) or max(ranks, default=0) >= template.n_vertices:
        raise ParameterError(
            "This surface has no natural coordinates; its modes are those of the springs of its "
            f"mesh, 0 to {template.n_vertices - 1}.",
            remedy="Name a mode by its rank: 'spring 3'.",
        )
    springs = spring_modes(template.faces, template.n_vertices, max(ranks) + 1)
    lowest = _of_template(template, springs, wave_speed, ())
    return replace(
        lowest,
        labels=tuple(labels),
        angular_frequencies=lowest.angular_frequencies[ranks],
        shapes=lowest.shapes[template.representatives][:, ranks],
    )


def _of_lattice(lattice: Lattice, modes: ModeSet) -> VibrationModes:
    return VibrationModes(
        lattice.topology.name,
        modes.labels,
        lattice.angular_frequencies(modes),
        lattice.shapes(modes),
        "rad per time unit for K = M = 1",
    )


def _of_template(
    template: Template, modes: Modes, wave_speed: float, notes: tuple[str, ...]
) -> VibrationModes:
    return VibrationModes(
        MESH if template.surface is None else template.surface.name,
        modes.labels,
        frequencies_of(modes, template, wave_speed),
        shapes_of(modes, template),
        f"rad/s for waves of {wave_speed:g} length units per s",
        notes,
    )


def _require_shown(template: Template, modes: ModeSet) -> None:
    """Refuse waves shorter than two steps of the mesh: its vertices show them as longer ones."""
    lengths = tuple(length if length > 0 else np.inf for length in template.lengths)
    if not len(template.faces):
        short = np.abs(modes.wavenumbers).max(axis=1) > template.n_vertices / 2
    else:
        edges = connectivity_of(template.faces, template.n_vertices).edges
        size = float(np.abs(template.vertices).max()) or 1.0
        steps = (template.vertices[edges[:, 0]] - template.vertices[edges[:, 1]]) / size
        step = size * float(np.sqrt((steps**2).sum(axis=1)).mean())
        short = modes.wavenumbers_on(lengths) * step > np.pi
    if short.any():
        label = modes.labels[int(np.flatnonzero(short)[0])]
        raise ParameterError(
            f"The waves of {label} are shorter than two steps of this mesh, which cannot show "
            "them.",
            remedy="Use smaller wavenumbers, or a finer mesh.",
            details={"label": str(label)},
        )
