"""A surface drawn to the edges of one image, coarse to fine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.images import PlaneSet
from modalmotion.images.sequence import Image
from modalmotion.numeric.cholesky import gram, inverse_of_cholesky
from modalmotion.numeric.products import product
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.image_levels import renewed
from modalmotion.tracking.image_view import Facets, Sight, View, view_of
from modalmotion.tracking.information import information
from modalmotion.tracking.noise import Noise
from modalmotion.tracking.observation import Frame
from modalmotion.tracking.passes import evidence
from modalmotion.tracking.prior import Prior
from modalmotion.tracking.settling import Settled, settle

Floats = NDArray[np.float64]

# Steps of one stage, and RMS of the last one, mm.
_MOST_STEPS: Final = 8
_SMALL: Final = 0.1

# mm: prior deviation of a slice's shift along each of its axes, before the shifts themselves say.
_LEAST_SHIFT: Final = 0.3
_MOST_SHIFT: Final = 4.0


@dataclass(frozen=True, eq=False)
class Search:
    """Where a search stands.

    Parameters
    ----------
    amplitudes : (modes, 3) float64, mm
    prior : Prior
    noise : Noise
    sight : Sight
    view : View
        About the shape before the last step.
    """

    amplitudes: Floats
    prior: Prior
    noise: Noise
    sight: Sight
    view: View


def search(
    surface: Deformable,
    facets: Facets,
    image: Image,
    marks: Frame,
    start: Floats,
    prior: Prior,
    noise: Noise,
    sight: Sight,
    reach: float,
    *,
    sights_too: bool,
    evidence_too: bool,
) -> Search:
    """Draw a surface to the edges within `reach` mm, sampling the image anew at each step.

    Parameters
    ----------
    surface : Deformable
    facets : Facets
    image : Volume or PlaneSet
    marks : Frame
        Landmarks of this frame.
    start : (modes, 3) float64, mm
    prior : Prior
    noise : Noise
    sight : Sight
    reach : float, mm
    sights_too, evidence_too : bool
        Whether levels, bias field and shifts of slices, and whether prior and noise are estimated
        with the shape.
    """
    a = start
    view = view_of(image, facets, surface.positions(a), sight, reach)
    for step in range(_MOST_STEPS):
        frame: Frame = (view.observation(), *marks)
        variances = prior.variances(surface.wavenumbers)
        if sights_too and isinstance(image, PlaneSet):
            own, sight = _with_shifts(surface, frame, view, a, prior, noise, sight)
        else:
            own = settle(surface, frame, a, variances, noise, most_steps=2)
        change = float(np.linalg.norm(own.amplitudes - a))
        a = own.amplitudes
        if evidence_too and step:
            prior, noise = evidence(surface, [own], prior)
        sight = renewed(sight, view) if sights_too and step else sight
        if change < _SMALL:
            break
        view = view_of(image, facets, surface.positions(a), sight, reach)
    return Search(a, prior, noise, sight, view)


def _with_shifts(
    surface: Deformable,
    frame: Frame,
    view: View,
    a: Floats,
    prior: Prior,
    noise: Noise,
    sight: Sight,
) -> tuple[Settled, Sight]:
    """Amplitudes and shifts of all planes in one step, for either could explain the other's part.

    Notes
    -----
    min sum s (n . (r - dt) - (phi n) . da)^2 + a' K a + t^2 / tau^2 over da and dt, where r is the
    way from the surface to an edge and n the surface's normal, for dt its part in the plane.
    """
    info = information(surface, a, frame, noise)
    rows = frame[0]
    counted = info.weights * (1.0 if rows.weights is None else rows.weights)
    strength = counted / noise.variances(rows.sd, float(counted.sum()))
    k = view.edges.is_found
    n = view.normals[k]
    e = view.directions[k]
    # Only along e a profile shows a shift in its plane; across it lies the curve itself.
    flat = (n * e).sum(axis=1, keepdims=True) * e
    phi = (view.shares[k][:, :, None] * surface.shapes[view.feet[k]]).sum(axis=1)
    m, p = len(surface), len(sight.shifts)
    C = np.zeros((3 * m, 3 * p))
    D = np.kron(np.eye(p), np.eye(3) / sight.shift_sd**2)
    g = -sight.shifts.ravel() / sight.shift_sd**2
    pull = strength * (info.residuals * n).sum(axis=1)
    for plane in range(p):
        own = view.planes[k] == plane
        block = slice(3 * plane, 3 * plane + 3)
        rows_a = (phi[own][:, :, None] * n[own][:, None, :]).reshape(int(own.sum()), 3 * m)
        C[:, block] = product(np.ascontiguousarray(rows_a.T), strength[own, None] * flat[own])
        D[block, block] += (strength[own, None] * flat[own]).T @ flat[own]
        g[block] += pull[own] @ flat[own]
    stiffness = np.repeat(1.0 / prior.variances(surface.wavenumbers), 3)
    H = np.block([[info.matrix + np.diag(stiffness), C], [C.T, D]])
    now = a.ravel()
    b = info.vector - product(info.matrix, now[:, None])[:, 0] - stiffness * now
    inverse = inverse_of_cholesky(H)
    step = product(np.ascontiguousarray(inverse.T), product(inverse, np.append(b, g)[:, None]))
    new = a + step[: 3 * m, 0].reshape(-1, 3)
    covariance = gram(inverse)[: 3 * m, : 3 * m]
    settled = Settled(new, info, np.ascontiguousarray(covariance))
    shifts = sight.shifts + step[3 * m :, 0].reshape(-1, 3)
    # What the images have set of them, of both axes of each plane; the third stays the prior's.
    set_by = 3 * p - np.diag(gram(inverse)[3 * m :, 3 * m :]).sum() / sight.shift_sd**2
    sd = float(np.sqrt((shifts**2).sum() / max(set_by, 1e-3 * p)))
    sd = float(np.clip(sd, _LEAST_SHIFT, _MOST_SHIFT))
    return settled, replace(sight, shifts=shifts, shift_sd=sd)
