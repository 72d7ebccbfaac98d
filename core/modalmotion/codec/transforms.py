"""The transforms that an encoder tries."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from modalmotion.codec.modes.graph import edges_of
from modalmotion.codec.modes.lattice_modes import LatticeModes
from modalmotion.codec.modes.modes_section import OrthonormalModes
from modalmotion.codec.modes.patch_modes import LARGEST_PATCH, MOST_WORK, Cut, PatchModes
from modalmotion.codec.target import Effort
from modalmotion.codec.temporal import Temporal
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topology import CLOSED, OPEN, OPEN_CURVE, Topology
from modalmotion.numerals import with_article

CUTS = {
    Effort.FAST: Cut(patch=2048, leaf=128, share=50),
    Effort.BALANCED: Cut(patch=LARGEST_PATCH, leaf=256, share=96),
}
"""How meshes are cut for their spring modes."""


@dataclass(frozen=True, eq=False)
class Choice:
    """Modes, and the temporal bases to try with them.

    Parameters
    ----------
    modes : OrthonormalModes
    kinds : tuple of Temporal
    effort : Effort
    name : str
        Name of the modes for people.
    """

    modes: OrthonormalModes
    kinds: tuple[Temporal, ...]
    effort: Effort
    name: str


def choose(sequence: MeshSequence, effort: Effort) -> Choice:
    """Choose the modes of a sequence, and the temporal bases to try."""
    on_lattice = sequence.grid is not None or not len(sequence.faces)
    if on_lattice:
        lattice = _lattice_modes(sequence)
        modes: OrthonormalModes = lattice
        name = f"closed-form modes of {with_article(str(lattice.topology))}"
    else:
        springs = _spring_modes(sequence, CUTS[effort])
        modes = springs
        name = f"spring modes, patches: {len(springs.patches)}"
    is_quick = effort == Effort.FAST
    kinds: tuple[Temporal, ...] = (Temporal.DCT, Temporal.TRAJECTORY)
    if is_quick:
        kinds = (Temporal.DCT if on_lattice else Temporal.TRAJECTORY,)
    if not on_lattice and not is_quick:
        kinds = (*kinds, Temporal.PARTS)
    if _is_cycle(sequence) and not (is_quick and not on_lattice):
        kinds = (Temporal.FOURIER, *(k for k in kinds if not is_quick))
    return Choice(modes, kinds, effort, name)


def _lattice_modes(sequence: MeshSequence) -> LatticeModes:
    grid = sequence.grid or (sequence.n_vertices,)
    topology = sequence.topology
    if topology is None or topology.n_axes != len(grid):
        # Cosines suit any numbers in a row.
        topology = OPEN_CURVE if len(grid) == 1 else Topology((OPEN,) * len(grid))
    frame = sequence.vertices[0].astype(np.float64).reshape(*grid, 3)
    frame = frame / max(float(np.abs(frame).max()), np.finfo(np.float64).tiny)
    lengths = []
    for axis, ends in enumerate(topology.ends):
        steps = np.linalg.norm(np.diff(frame, axis=axis), axis=-1).sum(axis=axis)
        length = float(steps.mean()) * (1.0 + (ends == CLOSED) / max(grid[axis] - 1, 1))
        lengths.append(length)
    shortest = min((length for length in lengths if length > 0), default=1.0)
    fineness = tuple(
        int(np.clip(np.rint(64.0 * shortest / length), 1, 255)) if length > 0 else 64
        for length in lengths
    )
    return LatticeModes(topology, grid, fineness)


def _spring_modes(sequence: MeshSequence, cut: Cut) -> PatchModes:
    n = sequence.n_vertices
    cut = replace(cut, patch=min(cut.patch, n), leaf=min(cut.leaf, n))
    while cut.work(n) > MOST_WORK and cut.patch > 1:
        patch = cut.patch // 2
        cut = replace(cut, patch=patch, leaf=min(cut.leaf, patch))
    return PatchModes(edges_of(sequence.faces), n, cut)


def _is_cycle(sequence: MeshSequence) -> bool:
    """Whether the last frame leads back to the first in a step like the others."""
    if sequence.n_frames < 4:
        return False
    vertices = sequence.vertices
    steps = [float(np.abs(vertices[i] - vertices[i - 1]).mean()) for i in range(sequence.n_frames)]
    return steps[0] <= 1.5 * float(np.median(steps[1:]))
