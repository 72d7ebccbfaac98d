"""Vertices at the same place in every frame: doubled rims, seams and sides."""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.mesh.checks import FloatArray
from modalmotion.mesh.connectivity import connectivity_of

# Odd numbers that mix the bits of x, y and z (Steele et al., Fast splittable pseudorandom number
# generators, 2014).
_MIXERS: Final = (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB)


def first_at_place(vertices: FloatArray) -> NDArray[np.int64]:
    """Find for each vertex the first one that lies exactly where it lies in every frame.

    Vertices that only meet, in some frames, stay apart.

    Parameters
    ----------
    vertices : (frames, vertices, 3) float32 or float64
        Finite. 0 and -0 are the same place.

    Returns
    -------
    (vertices,) int64
        The vertex itself where no other has all of its places.
    """
    first = np.arange(vertices.shape[1])
    hashes = _hashes(vertices[0])
    in_order = np.sort(hashes)
    if (in_order[1:] != in_order[:-1]).all():
        return first
    # Runs of equal hashes, each named by its first vertex: candidates, which every frame confirms.
    order = np.argsort(hashes, kind="stable")
    starts = np.append(True, in_order[1:] != in_order[:-1])
    first[order] = order[starts][np.cumsum(starts) - 1]
    others = np.flatnonzero(first != np.arange(len(first)))
    for positions in vertices:
        names = first[others]
        apart = others[(positions[others] != positions[names]).any(axis=1)]
        if len(apart):
            # Those that leave the first of their group may still lie with each other.
            first[apart] = _grouped(positions[apart], apart, first[apart])
    return first


def _hashes(positions: FloatArray) -> NDArray[np.uint64]:
    """Hash of each place, (vertices,): equal where places are, and hardly elsewhere."""
    # Adding zero turns -0 into 0, so that equal numbers have equal bits.
    bits = (positions.astype(np.float64) + 0.0).view(np.uint64)
    bits ^= bits >> np.uint64(29)
    hashes = np.zeros(len(bits), dtype=np.uint64)
    for axis, mixer in enumerate(_MIXERS):
        hashes = (hashes ^ bits[:, axis]) * np.uint64(mixer)
    return hashes


def _grouped(
    rows: FloatArray, vertices: NDArray[np.int64], groups: NDArray[np.int64]
) -> NDArray[np.int64]:
    """First vertex of those with the same row in the same group, for each; vertices increase."""
    order = np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0], groups))
    starts = np.ones(len(order), dtype=np.bool_)
    starts[1:] = groups[order[1:]] != groups[order[:-1]]
    starts[1:] |= (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    # lexsort is stable, so the first of a run is its smallest.
    names = np.empty_like(vertices)
    names[order] = vertices[order[starts]][np.cumsum(starts) - 1]
    return names


def representatives_of(vertices: FloatArray, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Merge vertices that coincide in every frame, where that joins the surface.

    Vertices at one place are one where border edges lie on each other (two rims, a seam), where
    a triangle repeats another, along an edge without length, and where a vertex is in no
    triangle. A surface that only touches itself in a point, or along edges that have their two
    triangles, stays as it is: joined there, it would not be a surface.

    Parameters
    ----------
    vertices : (frames, vertices, 3) float32 or float64
    faces : (faces, 3) int64

    Returns
    -------
    (vertices,) int64
        For each the first of the vertices that are one with it.
    """
    first = first_at_place(vertices)
    n = len(first)
    if (first == np.arange(n)).all():
        return first
    pairs = [
        _pairs_of_rows(first, _border(faces, n)),
        _pairs_of_rows(first, faces),
        _without_length(first, faces),
        _unused(first, faces),
    ]
    one, other = np.concatenate(pairs, axis=1)
    graph = scipy.sparse.coo_array((np.ones(len(one), dtype=np.int8), (one, other)), shape=(n, n))
    _, labels = scipy.sparse.csgraph.connected_components(graph, directed=False)
    _, smallest = np.unique(labels, return_index=True)
    merged: NDArray[np.int64] = smallest[labels]
    return merged


def _pairs_of_rows(first: NDArray[np.int64], rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Pairs of vertices of edges or triangles that lie on each other, (2, pairs)."""
    # Each row in the order of its places, so that columns belong together.
    rows = np.take_along_axis(rows, np.argsort(first[rows], axis=1, kind="stable"), axis=1)
    places = first[rows]
    # What is a point or an edge only lies on itself.
    proper = (places[:, 1:] != places[:, :-1]).all(axis=1)
    rows, places = rows[proper], places[proper]
    order = np.lexsort(places.T)
    rows, places = rows[order], places[order]
    same = (places[1:] == places[:-1]).all(axis=1)
    return np.stack([rows[:-1][same].ravel(), rows[1:][same].ravel()])


def _border(faces: NDArray[np.int64], n_vertices: int) -> NDArray[np.int64]:
    """Edges of one triangle, (edges, 2)."""
    connectivity = connectivity_of(faces, n_vertices)
    border: NDArray[np.int64] = connectivity.edges[connectivity.faces_at_edge == 1]
    return border


def _without_length(first: NDArray[np.int64], faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Pair the ends of each edge that lies in one place, (2, pairs)."""
    sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    pairs: NDArray[np.int64] = sides[first[sides[:, 0]] == first[sides[:, 1]]].T
    return pairs


def _unused(first: NDArray[np.int64], faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Vertices in no triangle, each with one at its place that is in one, (2, pairs)."""
    used = np.zeros(len(first), dtype=np.bool_)
    used[faces.ravel()] = True
    at_place = first.copy()
    # The last assignment stays: the first vertex in use, where there is one.
    backwards = np.flatnonzero(used)[::-1]
    at_place[first[backwards]] = backwards
    unused = np.flatnonzero(~used)
    return np.stack([unused, at_place[first[unused]]])
