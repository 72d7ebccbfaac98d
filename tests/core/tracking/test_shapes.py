"""Shapes of a track: exact for affine motions."""

from __future__ import annotations

import numpy as np
import pytest
from clouds import ends_of, rim_of, sampled

from modalmotion.mesh import cavity_of
from modalmotion.mesh.sequence import mesh_sequence, standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CUP
from modalmotion.template import make_template
from modalmotion.tracking import Observation, Track, track
from modalmotion.tracking.hdf5 import track_from_hdf5, track_to_hdf5

BASE = standard_surface(Lattice(CUP, (12, 20)))
X = BASE.vertices[0] * np.array([25.0, 25.0, 40.0])


@pytest.fixture(scope="module")
def even() -> tuple[float, Track]:
    """A cup that contracts evenly, and its true ejection fraction."""
    rng = np.random.default_rng(0)
    sizes = np.array([[1.0, 1.0, 1.0], [0.8, 0.8, 0.9], [0.7, 0.7, 0.8]])
    start = mesh_sequence(X[None], BASE.faces, unit="mm")
    s = make_template(start).coordinates[:, 0]
    rim = rim_of(BASE.faces, s)
    frames = [
        [Observation(sampled(size * X, BASE.faces, 300, rng)), *ends_of(size * X, s, rim)]
        for size in sizes
    ]
    volumes = np.abs(cavity_of(BASE.faces, len(X)).volume(sizes[:, None] * X))
    true = 100.0 * (1.0 - volumes.min() / volumes.max())
    return float(true), track(frames, start=start, modes=21, time="open")


def test_an_even_contraction_is_found_whole(even: tuple[float, Track]) -> None:
    true, result = even
    assert result.ejection_fraction == pytest.approx(true, abs=0.1)
    assert result.truncations.max() < 0.1


def test_positions_are_the_shapes_times_the_amplitudes(even: tuple[float, Track]) -> None:
    _, result = even
    found = result.template.vertices + result.shapes @ result.amplitudes[2]
    assert found == pytest.approx(result.sequence.vertices[2], abs=1e-4)
    again = track_from_hdf5(track_to_hdf5(result))
    assert np.array_equal(again.shapes, result.shapes)
