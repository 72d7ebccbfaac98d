"""What a track states of how far its vertices and its volumes may be off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh import face_areas, vertex_areas
from modalmotion.mesh.cavity_gradient import lid_gradient, volume_gradient
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.first_shape import FirstShape
from modalmotion.tracking.noise import Noise
from modalmotion.tracking.posterior import across_covariance, deviations_at, volume_deviation
from modalmotion.tracking.result import cavity_in, normals_of
from modalmotion.tracking.together import Together


def across_of(found: Together, pinned: int | None) -> NDArray[np.float64]:
    """Covariances across the surface, (frames, 3 modes, 3 modes); none where it is known."""
    pairs = zip(found.seen, found.information, strict=True)
    across = np.stack([across_covariance(seen, info) for seen, info in pairs])
    if pinned is not None:
        across[pinned] = 0.0
    return across


def stated_deviations(
    surface: Deformable,
    vertices: NDArray[np.float64],
    found: Together,
    across: NDArray[np.float64],
    noises: Sequence[Noise],
    pinned: int | None,
    shape: FirstShape | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Deviations of vertices and of volumes; none where the surface is known.

    Where the points of the reference left holes, its own shape is open by more than on most of the
    surface, in all frames.
    """
    template = surface.template
    cavity = cavity_in(template)
    of_vertices = np.zeros((*vertices.shape[:2], 2))
    of_volumes = None if cavity is None else np.zeros(len(vertices))
    for k, x in enumerate(vertices):
        if k == pinned:
            continue
        T = noises[k].truncation
        of_vertices[k] = deviations_at(
            surface.shapes, normals_of(template, x), across[k], found.lasting[k], T
        )
        if cavity is not None and of_volumes is not None:
            gradient = surface.shapes.T @ volume_gradient(cavity, x)
            of_lids = surface.shapes.T @ lid_gradient(cavity, x)
            area = float(face_areas(x, cavity.faces).sum())
            of_volumes[k] = volume_deviation(
                gradient, of_lids, across[k], found.lasting[k], area, T, noises[k].n_values
            )
            if shape is not None:
                # What the wall sweeps along its normals: rims along it are found in every frame.
                swept = vertex_areas(x, template.faces)[:, None] * normals_of(template, x)
                g = (shape.shapes.T @ swept).reshape(-1)
                of_volumes[k] = np.hypot(of_volumes[k], (g @ shape.covariance @ g) ** 0.5)
    if shape is not None:
        own = deviations_at(
            shape.shapes,
            normals_of(template, template.vertices),
            shape.covariance,
            shape.covariance,
            0.0,
        )[:, 0]
        beyond = np.maximum(own**2 - np.median(own) ** 2, 0.0)
        of_vertices[:, :, 0] = np.sqrt(of_vertices[:, :, 0] ** 2 + beyond)
    return of_vertices, of_volumes
