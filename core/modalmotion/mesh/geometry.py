"""Volume inside a surface, lines along its normals, and the sections in which planes cut it."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from modalmotion.errors import TopologyError
from modalmotion.mesh.triangles import connectivity_of, face_normals, grouped_edges, oriented_faces
from modalmotion.representation import Floats, Ints, shown

# Triangles passed without getting nearer to a line before it is given up: in noise as large as
# the triangles these are folded around it.
_PATIENCE: Final = 8

# More than a line crosses on its way over the surface, whatever that surface.
_MOST_STEPS: Final = 400

# Rounding of a share of a triangle, and of the distance from a line.
_ROUNDING: Final = 1e-9
_NEARER: Final = 1.0 - 1e-3


@dataclass(frozen=True, eq=False)
class NormalLines:
    """Straight lines through the vertices of a surface, along its normals.

    Parameters
    ----------
    faces : (faces, 3) int64
        All wound the same way round.
    vertices : (nodes,) int64
        Those that a line goes through.
    starts : (nodes, 3) float64, length unit
    directions : (nodes, 3, 3) float64
        In the rows two unit vectors across the line and the one along it.
    """

    faces: Ints
    vertices: Ints
    starts: Floats
    directions: Floats

    @staticmethod
    def of(faces: Ints, vertices: Ints, positions: Floats, normals: Floats) -> "NormalLines":
        """Lines through some vertices, (nodes,) int64, of positions and normals (vertices, 3)."""
        along = normals[vertices]
        # The axis that is farthest from the normal is across it.
        axes = np.eye(3)[np.abs(along).argmin(axis=1)]
        across = np.cross(along, axes)
        size = np.linalg.norm(across, axis=1, keepdims=True)
        across /= np.where(size > 0, size, 1.0)
        directions = np.stack([across, np.cross(along, across), along], axis=1)
        return NormalLines(faces, vertices, positions[vertices], directions)

    def some(self, rows: Ints) -> "NormalLines":
        """Return some of the lines."""
        part = NormalLines(
            self.faces, self.vertices[rows], self.starts[rows], self.directions[rows]
        )
        # The same surface: its tables are not made again.
        for name in ("_neighbours", "_rim", "_first"):
            part.__dict__[name] = getattr(self, name)
        return part

    def heights(self, positions: Floats) -> Floats:
        """Height above each line's start at which another shape of the surface meets it.

        From a triangle at the line's own vertex the way leads over the surface, each time across
        the side that the line is beyond, to the triangle that it goes through. So of several
        meetings the one that is joined to that vertex counts. Where the surface ends before the
        line, the height is that of the point of the rim next to it; where triangles fold around
        it, that of the nearest point passed.

        Parameters
        ----------
        positions : (frames, vertices, 3) float64, length unit

        Returns
        -------
        (frames, nodes) float64, length unit
        """
        f, n, _ = positions.shape
        m = len(self.vertices)
        # Direction by direction: products of so many small matrices are three times as slow.
        points: Floats = np.ascontiguousarray(positions.reshape(-1, 3).T)
        starts: Floats = np.ascontiguousarray(self.starts.T)
        faces: Ints = np.ascontiguousarray(self.faces.T)
        directions = np.ascontiguousarray(self.directions.transpose(1, 2, 0))
        line = np.tile(np.arange(m), f)
        first_point = np.repeat(np.arange(f) * n, m)
        # A side is three times its triangle and the corner that it is opposite to.
        side = 3 * np.tile(self._first[self.vertices], f)
        on_rim = np.zeros(f * m, dtype=np.bool_)
        nearest = np.full(f * m, np.inf)
        heights = np.zeros(f * m)
        stalled = np.zeros(f * m, dtype=np.int64)
        active = np.arange(f * m)
        neighbours, rim = self._neighbours, self._rim
        for _ in range(_MOST_STEPS):
            if not len(active):
                break
            face, own = np.divmod(side[active], 3)
            i = line[active]
            corners = points.take(first_point[active] + faces.take(face, axis=1), axis=1)
            corners -= starts.take(i, axis=1)[:, None]
            x, y, z = (np.einsum("dn,dkn->kn", one.take(i, axis=1), corners) for one in directions)
            # Twice the areas that the line's point cuts off: shares of the corners in it.
            cut = x[[1, 2, 0]] * y[[2, 0, 1]] - x[[2, 0, 1]] * y[[1, 2, 0]]
            area = cut[0] + cut[1] + cut[2]
            shares = cut / np.where(area == 0.0, np.inf, area)
            is_through = (shares.min(axis=0) >= -_ROUNDING) & (area != 0.0)
            through = active[is_through]
            heights[through] = (shares * z).sum(axis=0)[is_through]
            others = np.flatnonzero(~is_through)
            active, face, own = active[others], face[others], own[others]
            x, y, z, shares = (one.take(others, axis=1) for one in (x, y, z, shares))
            rows = np.arange(len(active))
            at_rim = on_rim[active]
            k = np.where(at_rim, own, shares.argmin(axis=0))
            ahead = neighbours[3 * face + k]
            at_rim |= ahead < 0
            # The nearest point of the side to cross.
            a, b = (k + 1) % 3, (k + 2) % 3
            dx, dy = x[b, rows] - x[a, rows], y[b, rows] - y[a, rows]
            length = dx * dx + dy * dy
            u = -(x[a, rows] * dx + y[a, rows] * dy) / np.where(length > 0, length, 1.0)
            np.clip(u, 0.0, 1.0, out=u)
            away = np.hypot(x[a, rows] + u * dx, y[a, rows] + u * dy)
            is_nearer = away < _NEARER * nearest[active]
            better = active[is_nearer]
            nearest[better] = away[is_nearer]
            heights[better] = (z[a, rows] * (1.0 - u) + z[b, rows] * u)[is_nearer]
            stalled[active] = np.where(is_nearer, 0, stalled[active] + 1)
            # Along the rim while that gets nearer; back inside where the line is on that side.
            inward = at_rim & on_rim[active] & (shares[k, rows] > 0)
            where_to = shares.argmin(axis=0)
            inside = neighbours[3 * face + where_to]
            step = np.where(u <= 0.0, rim[0, 3 * face + k], -1)
            step = np.where(u >= 1.0, rim[1, 3 * face + k], step)
            step = np.where(inward, np.where(inside < 0, -1, 3 * inside), step)
            goes = np.where(at_rim, is_nearer & (step >= 0), stalled[active] < _PATIENCE)
            side[active] = np.where(at_rim, step, 3 * ahead)
            on_rim[active] = at_rim & ~inward
            active = active[goes]
        return heights.reshape(f, m)

    @cached_property
    def _first(self) -> Ints:
        """One triangle at each vertex, (vertices,) int64; 0 at vertices in none."""
        first = np.zeros(int(self.faces.max()) + 1, dtype=np.int64)
        first[self.faces[::-1].ravel()] = np.repeat(np.arange(len(self.faces))[::-1], 3)
        return first

    @cached_property
    def _neighbours(self) -> Ints:
        """Triangle across each side, (sides,) int64; -1 on the rim."""
        start, end = self._ends
        key = np.minimum(start, end) * (self.faces.max() + 1) + np.maximum(start, end)
        order = np.argsort(key, kind="stable")
        twins = np.flatnonzero(key[order[1:]] == key[order[:-1]])
        one, other = order[twins], order[twins + 1]
        neighbours = np.full(len(key), -1)
        neighbours[one], neighbours[other] = other // 3, one // 3
        return neighbours

    @cached_property
    def _rim(self) -> Ints:
        """Side of the rim before and after each one on it, (2, sides) int64; -1 where none is."""
        start, end = self._ends
        rim = np.flatnonzero(self._neighbours < 0)
        begins, ends = (np.full(int(self.faces.max()) + 1, -1) for _ in range(2))
        begins[start[rim]], ends[end[rim]] = rim, rim
        table = np.full((2, len(start)), -1)
        table[0, rim], table[1, rim] = ends[start[rim]], begins[end[rim]]
        return table

    @property
    def _ends(self) -> tuple[Ints, Ints]:
        """Vertices at which each side begins and ends."""
        return self.faces[:, [1, 2, 0]].ravel(), self.faces[:, [2, 0, 1]].ravel()


def vertex_normals(positions: Floats, faces: Ints) -> Floats:
    """Take the mean normal of the triangles around each vertex, by area.

    Returns
    -------
    (vertices, 3) float64
        Of length 1. Zero at vertices in no triangle, or where the triangles around one cancel.
    """
    corners, of_faces = faces.ravel(), face_normals(positions, faces)
    sums = [np.bincount(corners, np.repeat(n, 3), minlength=len(positions)) for n in of_faces.T]
    normals = np.stack(sums, axis=1).astype(np.float64)
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.where(size > 0, size, 1.0)
    return normals


class Section(NamedTuple):
    """The curve in which a plane cuts a surface, as places on the mesh's edges.

    Parameters
    ----------
    corners : (n, 2) int64
        Vertices of each edge that is cut.
    shares : (n, 2) float64
        Of each of them in the place; they add up to 1.
    lengths : (n,) float64, length unit
        Of the curve that is next to each place.
    segments : (segments, 2) int64
        Places that a triangle joins.
    """

    corners: Ints
    shares: Floats
    lengths: Floats
    segments: Ints


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges of a triangle mesh, which many planes may cut.

    Parameters
    ----------
    ends : (edges, 2) int64
    of_faces : (faces, 3) int64
        Edges of each triangle.
    """

    ends: Ints
    of_faces: Ints

    @staticmethod
    def of(faces: Ints) -> "Edges":
        """List the edges of triangles."""
        sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        ends, places = np.unique(sides, axis=0, return_inverse=True)
        return Edges(ends, places.reshape(-1, 3))

    def cut(self, positions: Floats, heights: Floats) -> Section:
        """Cut the mesh where the heights of its vertices change their sign.

        Parameters
        ----------
        positions : (vertices, 3) float64, length unit
        heights : (vertices,) float64, length unit
            Above the plane; zero counts as above.
        """
        above = heights >= 0
        is_cut = above[self.ends[:, 0]] != above[self.ends[:, 1]]
        corners = self.ends[is_cut]
        low, high = heights[corners[:, 0]], heights[corners[:, 1]]
        t = low / (low - high)
        shares = np.stack([1.0 - t, t], axis=1)
        places = (shares[:, :, None] * positions[corners]).sum(axis=1)
        number = np.cumsum(is_cut) - 1
        # A plane cuts two edges of a triangle, or none.
        faces = self.of_faces[is_cut[self.of_faces].sum(axis=1) == 2]
        segments = number[faces[is_cut[faces]].reshape(-1, 2)]
        length = np.linalg.norm(places[segments[:, 0]] - places[segments[:, 1]], axis=1)
        halves = np.repeat(length / 2, 2).astype(np.float64)
        lengths: Floats = np.zeros(len(corners))
        np.add.at(lengths, segments.ravel(), halves)
        return Section(corners, shares, lengths, segments)


@shown()
@dataclass(frozen=True, eq=False)
class Cavity:
    """The cavity inside a surface's triangles, its openings closed by fans.

    For unchecked faces use `cavity_of`.

    Parameters
    ----------
    faces : (faces, 3) int64
        Consistently wound; outward for a positive volume.
    """

    faces: Ints

    def volume(self, vertices: Floats) -> Floats:
        """Volume enclosed by vertices in these positions.

        Parameters
        ----------
        vertices : (..., vertices, 3) float64, length unit
            Those in no triangle are not read.

        Returns
        -------
        (...) float64, length unit cubed

        Notes
        -----
        Divergence theorem: V = 1/6 sum a . (b x c) over the triangles of the closed surface.
        Each opening is closed by triangles from its edges to the mean of its vertices.
        """
        if not len(self.faces):
            return np.zeros(vertices.shape[:-2])
        # About a point nearby, so that a distant origin costs no digits.
        x, faces = self.closed(vertices - vertices[..., self.faces[0, :1], :])
        a, b, c = (x.take(faces[:, i], axis=-2) for i in range(3))
        # Sum of a . (b x c) / 6
        six_fold: Floats = (
            a[..., 0] * (b[..., 1] * c[..., 2] - b[..., 2] * c[..., 1])
            + a[..., 1] * (b[..., 2] * c[..., 0] - b[..., 0] * c[..., 2])
            + a[..., 2] * (b[..., 0] * c[..., 1] - b[..., 1] * c[..., 0])
        ).sum(axis=-1)
        return six_fold / 6.0

    def closed(self, x: Floats) -> tuple[Floats, Ints]:
        """Positions, (..., n, 3), and behind them the middle of each opening; faces with lids."""
        n, points, faces = x.shape[-2], [x], [self.faces]
        for k, edges in enumerate(self.openings):
            points.append(x[..., edges[:, 0], :].mean(axis=-2, keepdims=True))
            # An edge a -> b of a face is b -> a in the lid.
            faces.append(np.column_stack([np.full(len(edges), n + k), edges[:, ::-1]]))
        return np.concatenate(points, axis=-2), np.concatenate(faces)

    @cached_property
    def openings(self) -> tuple[Ints, ...]:
        """Edges around each opening, each from start to end as its triangle runs along it.

        Edges of openings that touch in a vertex are one opening: a fan over them closes both.
        """
        if not len(self.faces):
            return ()
        start, end = self.faces[:, [0, 1, 2]].ravel(), self.faces[:, [1, 2, 0]].ravel()
        n = int(self.faces.max()) + 1
        smaller, larger = np.minimum(start, end), np.maximum(start, end)
        _, first, counts = np.unique(smaller * n + larger, return_index=True, return_counts=True)
        border = np.sort(first[counts == 1])
        return tuple(grouped_edges(np.stack([start[border], end[border]], axis=1), n))


def cavity_of(faces: Ints, n_vertices: int) -> Cavity:
    """Check that a surface can enclose something, and wind its triangles alike.

    Parameters
    ----------
    faces : (faces, 3) int64
        In any winding; triangles that name a vertex twice or repeat another are left out.
    n_vertices : int

    Returns
    -------
    Cavity
        Wound as the first triangle is, so its volumes may be negative.

    Raises
    ------
    TopologyError
        If there are no triangles, if they form several pieces or not a surface, or if the
        surface has one side only.
    """
    connectivity = connectivity_of(faces, n_vertices)
    proper = np.delete(faces, connectivity.left_out, axis=0)
    if not len(proper):
        raise TopologyError(
            "There are no triangles, so nothing is enclosed.",
            remedy="Send a surface: triangles, or a lattice of two axes with its topology.",
        )
    if len(connectivity.non_manifold_edges):
        vertex = int(connectivity.non_manifold_edges[0, 0])
        raise TopologyError(
            f"{len(connectivity.non_manifold_edges)} edges belong to three triangles or more "
            f"(one of them at vertex {vertex}): such a surface has no inside.",
            remedy="Send the wall of the cavity alone, without inner sheets.",
            vertex=vertex,
        )
    if connectivity.n_components > 1:
        raise TopologyError(
            f"The triangles are {connectivity.n_components} separate pieces: which of them bound "
            "the cavity, and whether one is inside another, is unknown.",
            remedy="Send the surface of one cavity at a time.",
        )
    wound = oriented_faces(proper, n_vertices)
    if wound is None:
        raise TopologyError(
            "The surface has one side only, so it has no inside.",
            remedy="Send a surface with two sides.",
        )
    return Cavity(wound)


def volume_gradient(cavity: Cavity, x: Floats) -> Floats:
    """Differentiate the volume by each vertex, (vertices, 3) float64, length unit squared."""
    n = len(x)
    x, faces = cavity.closed(x - x[cavity.faces[0, 0]])
    total = np.zeros_like(x)
    for k in range(3):
        b, c = (x[faces[:, (k + i) % 3]] for i in (1, 2))
        np.add.at(total, faces[:, k], np.cross(b, c) / 6.0)
    for middle, edges in zip(total[n:], cavity.openings, strict=True):
        np.add.at(total, edges[:, 0], middle / len(edges))
    return total[:n]


def lid_gradient(cavity: Cavity, x: Floats) -> Floats:
    """Differentiate the volume by where the lids of openings are, (vertices, 3) float64.

    As if the wall went along: what is swept by each lid where its rim moves.
    """
    total = np.zeros_like(x)
    for edges in cavity.openings:
        middle = x[edges[:, 0]].mean(axis=0)
        start, end = x[edges[:, 0]] - middle, x[edges[:, 1]] - middle
        # A triangle sweeps its area vector times the mean of what its corners move by.
        areas = np.cross(end, start) / 6.0
        np.add.at(total, edges[:, 0], areas)
        np.add.at(total, edges[:, 1], areas)
        total[edges[:, 0]] += areas.sum(axis=0) / len(edges)
    return total
