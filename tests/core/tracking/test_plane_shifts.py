"""Shifts of slices: what they leave to doubt of a shape, against equations written out in full."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ellipsoid_images import AXES, BASE, LANDMARKS, MIDDLE, Look, off_surface, planes, spheroid

from modalmotion.representation import Floats
from modalmotion.tracking import track
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.image_frames import Scene, left_by_shifts
from modalmotion.tracking.image_view import Facets, Imaging, Levels, view_of
from modalmotion.tracking.map_frames import first_guess
from modalmotion.tracking.noise import Noise
from modalmotion.tracking.normal_equations import normal_equations
from modalmotion.tracking.observation import Frame, Observation

TEMPLATE = spheroid()
FACETS = Facets.of(TEMPLATE.faces, TEMPLATE.vertices, TEMPLATE.weights)
NORMALS = FACETS.normals(TEMPLATE.vertices)
SURFACE = Deformable.of(TEMPLATE, 7)
START = np.zeros((7, 3))
PRIOR, _ = first_guess(SURFACE)
NOISE = Noise(0.5, 0.2, 28.0)
LOOK = Look(noise=2.0)
IMAGING = Imaging(Levels(LOOK.blood, LOOK.wall, 1.0), np.zeros(3), MIDDLE, np.zeros((8, 3)))
VIEW = view_of(planes(look=LOOK), FACETS, TEMPLATE.vertices, IMAGING.within(4.0), 4.0)
SEEN: Frame = (VIEW.observation(),)


def left(sd: float, frame: Frame = SEEN) -> Floats:
    imaging = replace(IMAGING, shift_sd=sd)
    return left_by_shifts(Scene(SURFACE, frame, VIEW, START, PRIOR, NOISE, imaging), NORMALS)


def test_shifts_leave_what_the_whole_covariance_has_beyond_that_of_known_shifts() -> None:
    info = normal_equations(SURFACE, START, SEEN, NOISE)
    weights = info.weights * np.asarray(SEEN[0].weights)
    strength = weights / NOISE.variances(None, float(weights.sum()))
    k = VIEW.edges.is_found
    n, e = VIEW.normals[k], VIEW.directions[k]
    phi = (VIEW.shares[k][:, :, None] * SURFACE.shapes[VIEW.feet[k]]).sum(axis=1)
    of_shape = (phi[:, :, None] * n[:, None, :]).reshape(len(n), -1)
    of_shifts = np.zeros((len(n), 8, 3))
    of_shifts[np.arange(len(n)), VIEW.planes[k]] = (n * e).sum(axis=1, keepdims=True) * e
    J = np.concatenate([of_shape, of_shifts.reshape(len(n), -1)], axis=1)
    A = J.T @ (strength[:, None] * J) + np.diag(np.full(45, 1.5**-2))
    A[:21, :21] += SURFACE.stiffness(PRIOR.variances(SURFACE.wavenumbers)) - 1.5**-2 * np.eye(21)
    more = np.linalg.inv(A)[:21, :21] - np.linalg.inv(A[:21, :21])
    rows = (SURFACE.shapes[:, :, None] * NORMALS[:, None, :]).reshape(len(NORMALS), -1)
    expected = np.sqrt(((rows @ more) * rows).sum(axis=1))
    assert left(1.5) == pytest.approx(expected, rel=1e-3, abs=1e-4)
    assert expected.max() > 0.2


def test_less_is_left_where_less_is_shifted_or_landmarks_hold_the_shape() -> None:
    assert left(1e-3).max() < 1e-3
    assert (left(0.3) < left(2.0)).all()
    held = Observation(np.stack([LANDMARKS["apex"], BASE]), sd=0.2, places=("apex", "base"))
    assert left(2.0, (*SEEN, held)).mean() < 0.8 * left(2.0).mean()


@pytest.mark.thorough
def test_what_is_stated_of_shifted_slices_is_as_large_as_what_is_off() -> None:
    off, stated = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        shifts = np.array([rng.normal(0, 2, 2) @ AXES[:, :2].T for _ in range(8)])
        shifts[6:] = 0.0
        result = track(planes(shifts=shifts, seed=seed), landmarks=LANDMARKS)
        x = result.sequence.vertices[0].astype(np.float64)
        inner = (x - MIDDLE) @ AXES[:, 2] < 26.0
        off.append(off_surface(x[inner]))
        stated.append(result.deviations[0, inner, 0].mean())
        assert result.images is not None
        assert result.images.bent > 0.1
    # The mean size of a normal error is sqrt(2 / pi) of its deviation.
    assert np.mean(off) == pytest.approx(np.sqrt(2.0 / np.pi) * np.mean(stated), rel=0.5)
