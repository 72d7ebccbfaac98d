"""The same motion on other triangulations of the same surface of flat triangles."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.linalg import spsolve
from scipy.spatial import Delaunay, cKDTree
from template_surfaces import Floats, Ints, Moving

from modalmotion.mesh import connectivity_of, face_areas


def subdivided(moving: Moving) -> Moving:
    """Each triangle in four, with the motion interpolated linearly."""
    vertices, faces = moving
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges, index = np.unique(sides, axis=0, return_inverse=True)
    n, m = vertices.shape[1], len(faces)
    ab, bc, ca = (n + index.ravel()[k * m : (k + 1) * m] for k in range(3))
    a, b, c = faces.T
    finer = [np.stack(t, axis=1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
    middles = (vertices[:, edges[:, 0]] + vertices[:, edges[:, 1]]) / 2
    return np.concatenate([vertices, middles], axis=1), np.concatenate(finer)


def remeshed(moving: Moving, n: int, rng: np.random.Generator) -> Moving:
    """About `n` vertices at random on a cup, evenly spread, joined anew.

    Vertices lie on the triangles of the reference, and move as these do. They are joined by
    Delaunay's rule in a planar image of the surface, and sides are then flipped until the
    angles opposite to each are small in space.
    """
    vertices, faces = moving
    image, loops = _planar_image(vertices[0], faces)
    weights, n_inner, rims = _random_places(vertices[0], faces, loops, n, rng)
    places = weights @ image
    triangles = Delaunay(places).simplices.astype(np.int64)
    rim = np.full(len(places), -1)
    for k, (start, stop) in enumerate(rims):
        rim[n_inner + start : n_inner + stop] = k
    corners = rim[triangles]
    closes = (corners[:, 0] >= 0) & (corners[:, :1] == corners).all(axis=1)
    new = np.stack([weights @ frame for frame in vertices])
    triangles = _flipped(new[0], places, triangles[~closes])
    used, triangles = np.unique(triangles, return_inverse=True)
    return new[:, used], triangles.reshape(-1, 3)


def _ordered(loop: Ints) -> Ints:
    ahead: dict[int, list[int]] = {}
    for a, b in loop.tolist():
        ahead.setdefault(a, []).append(b)
        ahead.setdefault(b, []).append(a)
    order = [int(loop[0, 0]), int(loop[0, 1])]
    while len(order) < len(loop):
        one, other = ahead[order[-1]]
        order.append(other if one == order[-2] else one)
    return np.array(order)


def _planar_image(vertices: Floats, faces: Ints) -> tuple[Floats, list[Ints]]:
    """Tutte's embedding: the longest loop on a circle, others filled by a vertex each."""
    loops = [_ordered(loop) for loop in connectivity_of(faces, int(faces.max()) + 1).loops]
    steps = [np.linalg.norm(vertices[np.roll(p, -1)] - vertices[p], axis=1) for p in loops]
    loops = [loops[k] for k in np.argsort([-s.sum() for s in steps])]
    outer, n = loops[0], len(vertices)
    filled = [faces]
    for k, loop in enumerate(loops[1:]):
        filled.append(np.stack([loop, np.roll(loop, -1), np.full(len(loop), n + k)], axis=1))
    joined = np.concatenate(filled)
    total = n + len(loops) - 1
    rows, columns = joined[:, [0, 1, 2, 1, 2, 0]].ravel(), joined[:, [1, 2, 0, 0, 1, 2]].ravel()
    near = csr_array(coo_array((np.ones(len(rows)), (rows, columns)), shape=(total, total)))
    near.data[:] = 1.0
    balance = csr_array(diags_array(near.sum(axis=1)) - near)
    lengths = np.linalg.norm(vertices[np.roll(outer, -1)] - vertices[outer], axis=1)
    turn = 2 * np.pi * np.concatenate([[0], np.cumsum(lengths)[:-1]]) / lengths.sum()
    image = np.zeros((total, 2))
    image[outer] = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    free = np.setdiff1d(np.arange(total), outer)
    right = -(balance[free][:, outer] @ image[outer])
    image[free] = spsolve(balance[free][:, free].tocsc(), right)
    return image[:n], loops


def _random_places(
    vertices: Floats, faces: Ints, loops: list[Ints], n: int, rng: np.random.Generator
) -> tuple[csr_array, int, list[tuple[int, int]]]:
    areas = face_areas(vertices, faces)
    step = np.sqrt(areas.sum() / n)
    rows, rims, start = [], [], 0
    for loop in loops:
        ahead = np.roll(loop, -1)
        reached = np.concatenate(
            [[0], np.cumsum(np.linalg.norm(vertices[ahead] - vertices[loop], axis=1))]
        )
        count = max(round(float(reached[-1] / step)), 6)
        at = (np.arange(count) + rng.random()) * reached[-1] / count
        edge = np.clip(np.searchsorted(reached, at, side="right") - 1, 0, len(loop) - 1)
        share = (at - reached[edge]) / (reached[edge + 1] - reached[edge])
        rows.append((loop[edge], ahead[edge], share))
        rims.append((start, start + count))
        start += count
    # Far more candidates than needed, moved to the centres of what is nearest to them.
    pool = rng.choice(len(faces), 20 * n, p=areas / areas.sum())
    inside = rng.dirichlet([1, 1, 1], len(pool))
    candidates = np.einsum("mk,mkd->md", inside, vertices[faces[pool]])
    rim_places = np.concatenate(
        [vertices[a] * (1 - q)[:, None] + vertices[b] * q[:, None] for a, b, q in rows]
    )
    centres = candidates[rng.choice(len(pool), n - start, replace=False)]
    for _ in range(6):
        _, nearest = cKDTree(np.concatenate([centres, rim_places])).query(candidates)
        nearby = np.bincount(nearest, minlength=n)[: len(centres), None]
        sums = np.stack(
            [np.bincount(nearest, candidates[:, d], n)[: len(centres)] for d in range(3)], axis=1
        )
        centres = np.where(nearby > 0, sums / np.maximum(nearby, 1), centres)
    chosen = np.unique(cKDTree(candidates).query(centres)[1])
    m = len(chosen)
    entries = [(np.repeat(np.arange(m), 3), faces[pool[chosen]].ravel(), inside[chosen].ravel())]
    for (first, _), (a, b, q) in zip(rims, rows, strict=True):
        at = m + first + np.arange(len(a))
        entries += [(at, a, 1 - q), (at, b, q)]
    i, j, w = (np.concatenate(part) for part in zip(*entries, strict=True))
    return csr_array((w, (i, j)), shape=(m + start, len(vertices))), m, rims


def _flipped(vertices: Floats, image: Floats, triangles: Ints) -> Ints:
    def turn(a: Ints, b: Ints, c: Ints) -> Floats:
        u, v = image[b] - image[a], image[c] - image[a]
        crossed: Floats = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        return crossed

    def angle(at: Ints, a: Ints, b: Ints) -> Floats:
        u, v = vertices[a] - vertices[at], vertices[b] - vertices[at]
        cross = np.linalg.norm(np.cross(u, v), axis=1)
        opened: Floats = np.arctan2(cross, np.einsum("ij,ij->i", u, v))
        return opened

    triangles = triangles.copy()
    back = turn(*triangles.T) < 0
    triangles[back] = triangles[back][:, ::-1]
    n, m = len(image), len(triangles)
    for _ in range(60):
        start = np.concatenate([triangles[:, 0], triangles[:, 1], triangles[:, 2]])
        end = np.concatenate([triangles[:, 1], triangles[:, 2], triangles[:, 0]])
        tip = np.concatenate([triangles[:, 2], triangles[:, 0], triangles[:, 1]])
        key = np.minimum(start, end) * n + np.maximum(start, end)
        order = np.argsort(key, kind="stable")
        same = np.flatnonzero(key[order][1:] == key[order][:-1])
        i, j = order[same], order[same + 1]
        a, b, c, d = start[i], end[i], tip[i], tip[j]
        wanted = angle(c, a, b) + angle(d, a, b) > np.pi + 1e-9
        wanted &= (turn(a, d, c) > 1e-14) & (turn(b, c, d) > 1e-14)
        known, touched = set(key.tolist()), set()
        for q in np.flatnonzero(wanted):
            one, other = i[q] % m, j[q] % m
            side = min(c[q], d[q]) * n + max(c[q], d[q])
            if one in touched or other in touched or side in known:
                continue
            triangles[one] = a[q], d[q], c[q]
            triangles[other] = b[q], c[q], d[q]
            touched |= {one, other}
            known.add(side)
        if not touched:
            break
    return triangles
