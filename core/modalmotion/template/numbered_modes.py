"""The modes that describe a surface."""

from __future__ import annotations

from dataclasses import dataclass

from modalmotion.mesh.spring_modes import spring_modes
from modalmotion.modes import Modes, lowest_modes, whole_count
from modalmotion.template.template import Template


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
