"""Which modes a surface is described by, and at what frequencies they would swing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh import connectivity_of
from modalmotion.mesh.spring_modes import SpringModes, spring_modes
from modalmotion.modes import ModeSet, lowest_modes, wavenumbers_on, whole_count
from modalmotion.template.template import Template


@dataclass(frozen=True, eq=False)
class ModeChoice:
    """The modes that answer a request for a number of them.

    Parameters
    ----------
    modes : ModeSet or SpringModes
        In closed form where the surface has natural coordinates.
    notes : tuple of str
        Why there are more than were asked for, or that they belong to one mesh only.
    """

    modes: ModeSet | SpringModes
    notes: tuple[str, ...]


def choose_modes(
    template: Template, n_modes: int, grid: tuple[int, ...] | None = None
) -> ModeChoice:
    """Lowest modes of a template, rounded up so that no cosine-sine pair is split.

    Parameters
    ----------
    template : Template
    n_modes : int
    grid : tuple of int, optional
        Nodes along each axis of a lattice, which has no modes beyond its own number.

    Raises
    ------
    ModeCountError
        If there are not that many.
    """
    if template.surface is None:
        springs = spring_modes(template.faces, template.n_vertices, n_modes)
        note = (
            "These are the spring modes of this mesh; their amplitudes compare with those of "
            "meshes of the same connectivity only."
        )
        return ModeChoice(springs, (note,))
    n_whole = whole_count(template.surface, n_modes, grid)
    chosen = lowest_modes(template.surface, n_whole, grid)
    if n_whole == n_modes:
        return ModeChoice(chosen, ())
    note = (
        f"{n_modes} modes would split a cosine-sine pair; {n_whole} were fitted "
        f"({3 * n_whole} amplitudes a frame)."
    )
    return ModeChoice(chosen, (note,))


def frequencies_on(
    template: Template, modes: ModeSet | SpringModes, wave_speed: float
) -> NDArray[np.float64]:
    """Angular frequencies in the limit of long waves, w = c k.

    Parameters
    ----------
    template : Template
    modes : ModeSet or SpringModes
    wave_speed : float, length unit per s

    Returns
    -------
    (modes,) float64, rad per s
    """
    if isinstance(modes, SpringModes):
        edges = connectivity_of(template.faces, template.n_vertices).edges
        steps = template.vertices[edges[:, 0]] - template.vertices[edges[:, 1]]
        largest = float(np.abs(steps).max(initial=0.0)) or 1.0
        edge_length = largest * float(np.sqrt(((steps / largest) ** 2).sum(axis=1).mean()))
        if not edge_length > 0:
            return np.zeros(len(modes))
        return modes.angular_frequencies(wave_speed, edge_length)
    finite = tuple(length if length > 0 else np.inf for length in template.lengths)
    frequencies: NDArray[np.float64] = wave_speed * wavenumbers_on(modes, finite)
    return frequencies
