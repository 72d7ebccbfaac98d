"""Surfaces that fold over themselves, or collapse."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ShapeError
from modalmotion.mesh import Cavity
from modalmotion.mesh.areas import face_normals
from modalmotion.mesh.normal_lines import vertex_normals
from modalmotion.tracking.deformable import Deformable

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
            remedy="Leave the frame out if its points lie in one plane or on one side, or check "
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
