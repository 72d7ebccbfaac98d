"""A surface or curve that deforms in its closed-form modes; folds and collapses are refused."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ShapeError
from modalmotion.mesh import Cavity
from modalmotion.mesh.normal_lines import vertex_normals
from modalmotion.mesh.triangles import face_normals
from modalmotion.modes import ModeSet, lowest_modes, whole_count
from modalmotion.modes.topology import CLOSED, OPEN_CURVE
from modalmotion.template import Template
from modalmotion.template.body_frame import affine_shapes
from modalmotion.template.vibration_modes import shapes_of


@dataclass(frozen=True, eq=False)
class Deformable:
    """Positions x = x0 + Phi a, superposition (2) on a reference shape.

    Parameters
    ----------
    template : Template
        Of the reference shape x0.
    modes : ModeSet
    shapes : (vertices, modes) float64
        Phi, or what `exact_for_affine` makes of it.
    wavenumbers : (modes,) float64, 1
        |k| on the template's own lengths, times their geometric mean, so that no unit is left.
    """

    template: Template
    modes: ModeSet
    shapes: NDArray[np.float64]
    wavenumbers: NDArray[np.float64]

    @staticmethod
    def of(template: Template, n_modes: int) -> Deformable:
        """Take the lowest modes of a template, rounded up so that no pair is split."""
        modes = lowest_modes(template.topology, whole_count(template.topology, n_modes))
        k = modes.wavenumbers_on(template.lengths)
        length = float(np.exp(np.log(np.array(template.lengths)).mean()))
        return Deformable(template, modes, shapes_of(modes, template), k * length)

    def exact_for_affine(self) -> Deformable:
        """Let what the modes leave of an affine motion go with its amplitudes.

        What is even, as most of a heart's contraction is, then leaves nothing.
        """
        return replace(self, shapes=affine_shapes(self.shapes, self.template))

    def __len__(self) -> int:
        return len(self.modes)

    def positions(self, amplitudes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions, (vertices, 3), for amplitudes (modes, 3)."""
        return self.template.vertices + (self.shapes @ amplitudes)

    @cached_property
    def size(self) -> float:
        """RMS distance of the reference from its centroid, length unit."""
        x, w = self.template.vertices, self.template.weights[:, None]
        r = x - (w * x).sum(axis=0)
        return float(np.sqrt((w * r * r).sum()))

    @cached_property
    def area(self) -> float:
        """Area of the reference, length unit squared; of a curve its length."""
        x = self.template.vertices[self.cells]
        sides = x[:, 1:] - x[:, :1]
        if self.cells.shape[1] == 2:
            return float(np.linalg.norm(sides[:, 0], axis=1).sum())
        return float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum()) / 2.0

    @cached_property
    def cells(self) -> NDArray[np.int64]:
        """Triangles, (cells, 3), or segments of a curve, (cells, 2)."""
        if self.template.topology.n_axes > 1:
            a, b, c = self.template.faces.T
            proper: NDArray[np.int64] = self.template.faces[(a != b) & (b != c) & (c != a)]
            return proper
        n = self.template.n_vertices
        start = np.arange(n if self.template.topology.ends[0] == CLOSED else n - 1)
        return np.stack([start, (start + 1) % n], axis=1)

    @cached_property
    def rim(self) -> NDArray[np.bool_]:
        """Vertices where the surface ends, (vertices,)."""
        rim = np.zeros(self.template.n_vertices, dtype=np.bool_)
        if self.template.topology == OPEN_CURVE:
            rim[[0, -1]] = True
        rim[self.rim_sides] = True
        return rim

    @cached_property
    def rim_sides(self) -> NDArray[np.int64]:
        """Sides of triangles without a neighbour, (sides, 2); none of a curve."""
        if self.cells.shape[1] != 3:
            return np.zeros((0, 2), dtype=np.int64)
        sides = np.sort(self.cells[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        sides, counts = np.unique(sides, axis=0, return_counts=True)
        open_sides: NDArray[np.int64] = sides[counts == 1]
        return open_sides


# Share of the area in triangles turned against their neighbours. A single sliver may turn.
_MOST_FOLDED = 0.01


# Of the largest: a cavity that encloses less is none.
_LEAST_VOLUME = 0.01


def require_volume(cavity: Cavity | None, vertices: NDArray[np.float64]) -> None:
    """Check that a surface that encloses a volume does so in every frame.

    Parameters
    ----------
    cavity : Cavity or None
        None of what encloses none.
    vertices : (frames, vertices, 3) float64, length unit

    Raises
    ------
    ShapeError
        Naming the frame whose volume is less than 1 % of the largest.
    """
    if cavity is None or len(vertices) < 2:
        return
    volumes = np.abs(cavity.volume(vertices))
    frame, largest = int(volumes.argmin()), float(volumes.max())
    if volumes[frame] < _LEAST_VOLUME * largest:
        raise ShapeError(
            f"In frame {frame} the surface collapses: it encloses "
            f"{volumes[frame] / largest:.2%} of its largest volume.",
            remedy="Leave the frame out if its points are in one plane or on one side, or check "
            "the topology and the unit of each frame.",
            frame=frame,
            details={"share": float(volumes[frame]) / largest},
        )


def require_unfolded(surface: Deformable, vertices: NDArray[np.float64]) -> None:
    """Check that no frame has folds that the start has not.

    Parameters
    ----------
    surface : Deformable
    vertices : (frames, vertices, 3) float64, length unit

    Raises
    ------
    ShapeError
        Naming the first frame with more than 1 % of the area turned over that was not so at first.
    """
    if surface.cells.shape[1] != 3:
        return
    # A faithful mesh may have sharp folds of its own.
    at_rest = _turned(surface, surface.template.vertices)[0]
    for frame, x in enumerate(vertices):
        turned, areas = _turned(surface, x)
        folded = float(areas[turned & ~at_rest].sum() / (areas.sum() or 1.0))
        if not folded <= _MOST_FOLDED:
            raise ShapeError(
                f"In frame {frame} the surface folds over itself on {folded:.0%} of its area: the "
                "data do not fit a surface of this topology from this start.",
                remedy="Check the landmarks and the topology, ask for fewer modes, or give a "
                "surface near the data as start.",
                frame=frame,
                details={"folded": folded},
            )


def _turned(
    surface: Deformable, x: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Triangles turned against their neighbours, and the areas of all."""
    own = face_normals(x, surface.cells)
    around = vertex_normals(x, surface.cells)[surface.cells].sum(axis=1)
    return (own * around).sum(axis=1) < 0, np.linalg.norm(own, axis=1)
