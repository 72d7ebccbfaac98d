from __future__ import annotations

import numpy as np
import pytest

from modalmotion.mesh.laplacian import space_order


def test_neighbours_in_space_are_near_in_the_order() -> None:
    places = np.random.default_rng(0).uniform(-3.0, 5.0, (4000, 3))
    order = space_order(places)
    assert sorted(order) == list(range(4000))
    steps = np.linalg.norm(np.diff(places[order], axis=0), axis=1)
    assert np.median(steps) < 0.15 * np.median(np.linalg.norm(np.diff(places, axis=0), axis=1))


def test_it_is_the_order_of_the_bits_in_turn() -> None:
    """Against the definition: bits of z, y, x in turn, the most significant first."""
    places = np.random.default_rng(1).uniform(0.0, 1.0, (200, 3))
    low, span = places.min(axis=0), np.ptp(places, axis=0).max()
    steps = ((places - low) * ((2**21 - 1) / span)).astype(int)
    codes = ["".join(f"{z:021b}{y:021b}{x:021b}"[k::21] for k in range(21)) for x, y, z in steps]
    assert list(space_order(places)) == sorted(range(200), key=codes.__getitem__)


@pytest.mark.parametrize("places", [np.zeros((0, 3)), np.zeros((5, 3)), np.ones((1, 3)) * 1e9])
def test_points_at_one_place_stay_in_their_order(places: np.ndarray) -> None:
    assert list(space_order(places)) == list(range(len(places)))
