"""Vertices that lie together in every frame, and those that only meet."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from modalmotion.mesh.triangles import first_at_place
from modalmotion.representation import FloatArray

# Few values, so that vertices meet in some frames and part in others.
_PATHS = arrays(
    st.sampled_from([np.float32, np.float64]),
    st.tuples(st.integers(1, 4), st.integers(1, 12), st.just(3)),
    elements=st.sampled_from([0.0, -0.0, 1.0]),
)


def slowly(vertices: FloatArray) -> list[int]:
    """Each vertex against all before it."""
    n = vertices.shape[1]
    return [next(i for i in range(n) if (vertices[:, i] == vertices[:, j]).all()) for j in range(n)]


@given(_PATHS)
def test_it_is_what_comparing_each_with_each_finds(vertices: FloatArray) -> None:
    assert first_at_place(vertices).tolist() == slowly(vertices)


def test_places_of_the_same_key_are_told_apart() -> None:
    # Keys are sums with fixed shares: these places have the same.
    one, other = [0.27182818, 0.0, 1.0], [0.0, 0.31415927, 1.0]
    x = np.array([[one, other, one, other]])
    assert first_at_place(np.repeat(x, 2, axis=0)).tolist() == [0, 1, 0, 1]


def test_no_two_points_of_a_lattice_have_the_same_key(monkeypatch: pytest.MonkeyPatch) -> None:
    nodes = np.stack(np.meshgrid(*[np.arange(40.0)] * 3), axis=-1).reshape(1, -1, 3)
    # Each of the same key would be compared in every frame.
    monkeypatch.setattr("modalmotion.mesh.triangles._grouped", None)
    for vertices in (nodes, nodes.astype(np.float32) - 17.5):
        assert (first_at_place(vertices) == np.arange(40**3)).all()


def test_a_contact_of_one_frame_joins_nothing() -> None:
    x = np.random.default_rng(3).normal(size=(5, 30, 3))
    x[:4, 20] = x[:4, 7]
    x[2] = x[2, 0]
    assert first_at_place(x).tolist() == list(range(30))
    x[4, 20] = x[4, 7]
    assert np.flatnonzero(first_at_place(x) != np.arange(30)).tolist() == [20]
