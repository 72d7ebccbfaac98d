"""Patches of a mesh: a partition, connected, small enough, and the same in both forms."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
from text_of_modes import patches_of as in_words

from modalmotion.codec.joined_modes import edges_of, patches_of


@pytest.mark.parametrize("largest", [1, 2, 7, 60, 1000])
def test_patches_are_connected_and_small_enough(largest: int, rng: np.random.Generator) -> None:
    faces = rng.integers(0, 190, size=(170, 3))
    edges, n = edges_of(faces), 193
    patches = patches_of(edges, n, largest)
    sides = {(a, b) for a, b in edges.tolist()}
    assert [p.tolist() for p in patches] == in_words(set(range(n)), sides, largest)
    assert np.array_equal(np.sort(np.concatenate(patches)), np.arange(n))
    assert [int(p[0]) for p in patches] == sorted(int(p.min()) for p in patches)
    graph = scipy.sparse.coo_array((np.ones(len(edges)), edges.T), shape=(n, n)).tocsr()
    for patch in patches:
        assert len(patch) <= largest
        parts, _ = scipy.sparse.csgraph.connected_components(graph[patch][:, patch], directed=False)
        assert parts == 1


def test_a_path_is_cut_in_the_middle() -> None:
    order = np.random.default_rng(2).permutation(11)
    edges = np.sort(np.stack([order[:-1], order[1:]], axis=1), axis=1)
    patches = patches_of(edges, 11, 6)
    assert {frozenset(p.tolist()) for p in patches} in (
        {frozenset(order[:5].tolist()), frozenset(order[5:].tolist())},
        {frozenset(order[:6].tolist()), frozenset(order[6:].tolist())},
    )
