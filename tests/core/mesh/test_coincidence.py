"""Vertices that lie together in every frame, and those that only meet."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from modalmotion.mesh.checks import FloatArray
from modalmotion.mesh.sequence import first_at_place

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
    x = np.array([[[0.23, 0.0, 1.0], [0.0, 0.31, 1.0], [0.23, 0.0, 1.0], [0.0, 0.31, 1.0]]])
    assert first_at_place(np.repeat(x, 2, axis=0)).tolist() == [0, 1, 0, 1]


def test_a_contact_of_one_frame_joins_nothing() -> None:
    x = np.random.default_rng(3).normal(size=(5, 30, 3))
    x[:4, 20] = x[:4, 7]
    x[2] = x[2, 0]
    assert first_at_place(x).tolist() == list(range(30))
    x[4, 20] = x[4, 7]
    assert np.flatnonzero(first_at_place(x) != np.arange(30)).tolist() == [20]
