"""The modes of one surface: their labels, frequencies and shapes."""

from dataclasses import dataclass, replace

import numpy as np

from modalmotion import errors, mesh
from modalmotion.mesh.spring_modes import Modes, spring_modes, whole_counts
from modalmotion.modes import ModeLabel, ModeSet, topologies
from modalmotion.modes.lattice import Lattice, modes_named
from modalmotion.notes import Note
from modalmotion.representation import Floats, shown
from modalmotion.template.template import Template, choose_modes, frequencies_of, shapes_of


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
    notes : tuple of Note
    """

    surface: str
    labels: tuple[ModeLabel, ...]
    angular_frequencies: Floats
    shapes: Floats
    frequency_unit: str
    notes: tuple[Note, ...] = ()

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
    modes, notes = choose_modes(template, min(n_modes, template.n_vertices + 1))
    if len(modes) > template.n_vertices:
        counts = whole_counts(modes)
        most = int(counts[counts <= template.n_vertices].max(initial=1))
        raise errors.ModeCountError(
            f"{n_modes} modes were requested on {template.n_vertices} vertices.",
            remedy=f"Ask for at most {most} modes.",
        )
    return _of_template(template, modes, wave_speed, notes)


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
        raise errors.ParameterError(
            "This surface has no natural coordinates; its modes are the spring modes of its mesh, "
            f"0 to {template.n_vertices - 1}.",
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
    template: Template, modes: Modes, wave_speed: float, notes: tuple[Note, ...]
) -> VibrationModes:
    return VibrationModes(
        topologies.MESH if template.surface is None else template.surface.name,
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
        edges = mesh.connectivity_of(template.faces, template.n_vertices).edges
        size = float(np.abs(template.vertices).max()) or 1.0
        steps = (template.vertices[edges[:, 0]] - template.vertices[edges[:, 1]]) / size
        step = size * float(np.sqrt((steps**2).sum(axis=1)).mean())
        short = modes.wavenumbers_on(lengths) * step > np.pi
    if short.any():
        label = modes.labels[int(np.flatnonzero(short)[0])]
        raise errors.ParameterError(
            f"The waves of {label} are shorter than two edge lengths of this mesh, which cannot "
            "resolve them.",
            remedy="Use smaller wavenumbers, or a finer mesh.",
        )
