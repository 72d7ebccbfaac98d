"""Pictures show a ventricle as clinicians do, whatever the axes of its file."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import modalmotion as mm
from modalmotion.pictures.signature import signature_figure


@pytest.mark.every(3)
@pytest.mark.parametrize("seed", range(6))
def test_the_apex_points_down_however_the_surface_lies(seed: int) -> None:
    rng = np.random.default_rng(seed)
    beat = mm.simulate_ventricle(n_vertices=200, rng=rng)
    order = rng.permutation(beat.n_vertices)
    turned = (
        np.asarray(beat.vertices, dtype=np.float64)[::12, order]
        @ Rotation.random(random_state=rng).as_matrix()
    )
    lying = mm.mesh_sequence(turned, faces=np.argsort(order)[beat.faces], unit="mm")
    axes = signature_figure(lying, mm.modal_signature(lying)).axes[0]
    surface: Any = axes.collections[0]
    corners = np.asarray(surface._faces).reshape(-1, 3)
    up = corners[:, 2]
    top, bottom = corners[up > np.quantile(up, 0.85)], corners[up < np.quantile(up, 0.15)]
    assert np.ptp(top[:, 0]) > np.ptp(bottom[:, 0])
