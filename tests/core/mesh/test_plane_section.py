"""Sections: a plane's curve on a mesh, by length and as places on edges."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.mesh.geometry import Edges
from modalmotion.simulate import Acquisition, simulate_ventricle

BEAT = simulate_ventricle(grid=(16, 24), acquisition=Acquisition(n_frames=1))
X = BEAT.vertices[0].astype(np.float64)


@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.4, -0.5, 0.7)])
def test_places_lie_on_the_plane_and_the_curve_is_as_long_as_its_segments(
    direction: tuple[float, float, float],
) -> None:
    heights = (X - X.mean(axis=0)) @ (np.array(direction) / np.linalg.norm(direction))
    cut = Edges.of(BEAT.faces).cut(X, heights)
    assert (cut.shares * heights[cut.corners]).sum(axis=1) == pytest.approx(0.0, abs=1e-9)
    assert ((cut.shares >= 0) & (cut.shares <= 1)).all()
    places = (cut.shares[:, :, None] * X[cut.corners]).sum(axis=1)
    a, b = places[cut.segments[:, 0]], places[cut.segments[:, 1]]
    assert cut.lengths.sum() == pytest.approx(np.linalg.norm(a - b, axis=1).sum())


def test_a_ring_is_as_long_as_its_circle() -> None:
    z = 0.5 * (X[:, 2].min() + X[:, 2].max())
    cut = Edges.of(BEAT.faces).cut(X, X[:, 2] - z)
    places = (cut.shares[:, :, None] * X[cut.corners]).sum(axis=1)
    radius = np.linalg.norm(places[:, :2], axis=1).mean()
    assert cut.lengths.sum() == pytest.approx(2 * np.pi * radius, rel=0.02)


def test_a_plane_beside_the_surface_cuts_nothing() -> None:
    cut = Edges.of(BEAT.faces).cut(X, X[:, 2] + 1000.0)
    assert len(cut.corners) == len(cut.segments) == len(cut.lengths) == 0
