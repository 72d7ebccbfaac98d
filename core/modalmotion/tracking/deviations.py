"""How far vertices and volumes may be off, across the surface and along it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from modalmotion.mesh import face_areas, vertex_areas
from modalmotion.mesh.checks import Uncertainty
from modalmotion.mesh.geometry import lid_gradient, volume_gradient
from modalmotion.representation import Floats
from modalmotion.template import Template
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.first_shape import FirstShape
from modalmotion.tracking.map_frames import FramesEstimate
from modalmotion.tracking.noise import Noise
from modalmotion.tracking.result import cavity_in, normals_of


def deviations_at(
    shapes: Floats, normals: Floats, across: Floats, along: Floats, truncation: float
) -> Floats:
    """State how far each vertex may be off along its normal, and in each tangent direction.

    Parameters
    ----------
    shapes : (vertices, modes) float64
    normals : (vertices, 3) float64
    across : (3 modes, 3 modes) float64, length unit squared
        As `across_covariance` returns it.
    along : (3 modes, 3 modes) float64, length unit squared
        Of the amplitudes, where frames that see the same truncation count as one.
    truncation : float, length unit
        T, of what the modes leave in each direction.

    Returns
    -------
    (vertices, 2) float64, length unit
    """
    n = np.einsum("vi,vij,vj->v", normals, _at(shapes, across), normals)
    full = _at(shapes, along)
    rest = np.trace(full, axis1=1, axis2=2) - np.einsum("vi,vij,vj->v", normals, full, normals)
    variances = np.stack([n, rest / 2.0], axis=1) + truncation**2
    deviations: Floats = np.sqrt(np.maximum(variances, 0.0))
    return deviations


def uncertainty_of(
    template: Template,
    shapes: Floats,
    across: Floats,
    along: Floats,
    truncations: Floats,
    n_values: float,
    pinned: int | None,
) -> Uncertainty:
    """Put together how far all positions of a track may be off.

    Parameters
    ----------
    template : Template
    shapes : (vertices, modes) float64
    across, along : (frames, 3 modes, 3 modes) float64, length unit squared
        As for `deviations_at`.
    truncations : (frames,) float64, length unit
    n_values : float
        Independent values of what the modes leave: each is shared by a patch of the surface.
    pinned : int or None
        Frame that is known.
    """
    if pinned is not None:
        along = along.copy()
        along[pinned] = 0.0
    w = template.weights
    return Uncertainty(
        source="track",
        shapes=shapes,
        across=across,
        along=along,
        rest=truncations,
        # A vertex without a share of the surface counts for nothing.
        alike=1.0 / (n_values * np.where(w > 0, w, np.inf)),
    )


def volume_deviation(
    gradient: Floats,
    of_lids: Floats,
    across: Floats,
    along: Floats,
    area: float,
    truncation: float,
    n_values: float,
) -> float:
    """State how far a volume may be off, length unit cubed.

    The volume is linear in small changes of the amplitudes. What the modes leave has a mean over
    the surface of truncation / sqrt(n_values). Rims move along the surface where they move their
    lids: there residuals show nothing of it, and the whole covariance counts.

    Parameters
    ----------
    gradient : (modes, 3) float64, length unit squared
        Of the volume by the amplitudes.
    of_lids : (modes, 3) float64, length unit squared
        Of the part of it that the lids of openings move.
    across, along : (3 modes, 3 modes) float64, length unit squared
        As for `deviations_at`.
    area : float, length unit squared
    truncation : float, length unit
    n_values : float
    """
    g = gradient.reshape(-1, 1)
    lid = of_lids.reshape(-1, 1)
    variance = float((g * (across @ g)).sum()) + (area * truncation) ** 2 / n_values
    variance += max(float((lid * ((along - across) @ lid)).sum()), 0.0)
    return float(np.sqrt(max(variance, 0.0)))


def _at(shapes: Floats, covariance: Floats) -> Floats:
    """Covariance of each vertex, (vertices, 3, 3)."""
    m = shapes.shape[1]
    C = covariance.reshape(m, 3, m, 3)
    full = np.empty((len(shapes), 3, 3))
    for i in range(3):
        for j in range(i, 3):
            half = shapes @ C[:, i, :, j]
            full[:, i, j] = full[:, j, i] = (half * shapes).sum(axis=1)
    return full


def stated_deviations(
    surface: Deformable,
    vertices: Floats,
    found: FramesEstimate,
    noises: Sequence[Noise],
    pinned: int | None,
    shape: FirstShape | None = None,
) -> tuple[Floats, Floats | None]:
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
            surface.shapes, normals_of(template, x), found.across[k], found.lasting[k], T
        )
        if cavity is not None and of_volumes is not None:
            gradient = surface.shapes.T @ volume_gradient(cavity, x)
            of_lids = surface.shapes.T @ lid_gradient(cavity, x)
            area = float(face_areas(x, cavity.faces).sum())
            of_volumes[k] = volume_deviation(
                gradient, of_lids, found.across[k], found.lasting[k], area, T, noises[k].n_values
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
