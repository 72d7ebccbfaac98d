"""Shifts of slices, unknown together with the shape that they show aside."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.numeric.cholesky import gram, inverse_of_cholesky
from modalmotion.numeric.products import product
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.image_view import Sight, View
from modalmotion.tracking.information import Information, information
from modalmotion.tracking.noise import Noise
from modalmotion.tracking.observation import Frame
from modalmotion.tracking.prior import Prior
from modalmotion.tracking.settling import Settled

Floats = NDArray[np.float64]

# mm: prior deviation of a slice's shift along each of its axes, before the shifts themselves say.
_LEAST_SHIFT: Final = 0.3
_MOST_SHIFT: Final = 4.0


class _Joint(NamedTuple):
    """Equations of the shape and of all shifts: (H, C; C', D) and what pulls at the shifts."""

    info: Information
    stiffness: Floats
    H: Floats
    C: Floats
    D: Floats
    pull: Floats


def with_shifts(
    surface: Deformable,
    frame: Frame,
    view: View,
    a: Floats,
    prior: Prior,
    noise: Noise,
    sight: Sight,
) -> tuple[Settled, Sight]:
    """Amplitudes and shifts of all planes in one step, for either could explain the other's part.

    Parameters
    ----------
    surface : Deformable
    frame : Frame
        What the view observed first, then landmarks.
    view : View
    a : (modes, 3) float64, mm
    prior : Prior
    noise : Noise
    sight : Sight

    Notes
    -----
    min sum s (n . (r - dt) - (phi n) . da)^2 + a' K a + t^2 / tau^2 over da and dt, where r is the
    way from the surface to an edge and n the surface's normal, for dt its part in the plane.
    """
    joint = _joint(surface, frame, view, a, prior, noise, sight)
    info, m, p = joint.info, len(surface), len(sight.shifts)
    now = a.ravel()
    b = info.vector - product(info.matrix, now[:, None])[:, 0] - joint.stiffness * now
    inverse = inverse_of_cholesky(np.block([[joint.H, joint.C], [joint.C.T, joint.D]]))
    right = np.append(b, joint.pull)[:, None]
    step = product(np.ascontiguousarray(inverse.T), product(inverse, right))
    new = a + step[: 3 * m, 0].reshape(-1, 3)
    covariance = gram(inverse)[: 3 * m, : 3 * m]
    settled = Settled(new, info, np.ascontiguousarray(covariance))
    shifts = sight.shifts + step[3 * m :, 0].reshape(-1, 3)
    # What the images have set of them, of both axes of each plane; the third stays the prior's.
    set_by = 3 * p - np.diag(gram(inverse)[3 * m :, 3 * m :]).sum() / sight.shift_sd**2
    sd = float(np.sqrt((shifts**2).sum() / max(set_by, 1e-3 * p)))
    sd = float(np.clip(sd, _LEAST_SHIFT, _MOST_SHIFT))
    return settled, replace(sight, shifts=shifts, shift_sd=sd)


def left_by_shifts(
    surface: Deformable,
    frame: Frame,
    view: View,
    a: Floats,
    prior: Prior,
    noise: Noise,
    sight: Sight,
    normals: Floats,
) -> Floats:
    """Deviation across the surface that shifts leave, (vertices,) mm.

    Parameters
    ----------
    surface, frame, view, a, prior, noise, sight
        As for `with_shifts`, where it has come to rest.
    normals : (vertices, 3) float64

    Notes
    -----
    An estimate of the shape that takes the shifts found for true moves by -H^-1 C dt where they
    are wrong by dt, and no residual shows it. S, the covariance of dt whatever the shape is, is
    the block of the inverse of (H, C; C', D), that is (D - C' H^-1 C)^-1, so that the shape has
    H^-1 C S C' H^-1 more than the covariance H^-1 that it has for known shifts.
    """
    joint = _joint(surface, frame, view, a, prior, noise, sight)
    inverse = inverse_of_cholesky(joint.H)
    half = product(inverse, joint.C)
    S = gram(inverse_of_cholesky(joint.D - product(np.ascontiguousarray(half.T), half)))
    moved = product(np.ascontiguousarray(inverse.T), half)
    rows = (surface.shapes[:, :, None] * normals[:, None, :]).reshape(len(normals), -1)
    seen = product(rows, moved)
    deviations: Floats = np.sqrt(np.maximum((product(seen, S) * seen).sum(axis=1), 0.0))
    return deviations


def _joint(
    surface: Deformable,
    frame: Frame,
    view: View,
    a: Floats,
    prior: Prior,
    noise: Noise,
    sight: Sight,
) -> _Joint:
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
    D = np.asarray(np.kron(np.eye(p), np.eye(3)) / sight.shift_sd**2, dtype=np.float64)
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
    H: Floats = info.matrix + np.diag(stiffness)
    return _Joint(info, stiffness, H, C, D, g)
