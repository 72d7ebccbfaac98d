"""What an image shows of a surface near a shape: edges on profiles along its normals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from modalmotion.images import Plane, PlaneSet, Volume
from modalmotion.images.edges import Edges, Levels, find_edges, offsets_of
from modalmotion.images.sequence import Image
from modalmotion.mesh import Cavity
from modalmotion.mesh.geometry import Edges as MeshEdges
from modalmotion.mesh.geometry import vertex_normals
from modalmotion.representation import Floats, Ints
from modalmotion.tracking.observation import Observation

# Profiles through a volume.
_N_PROFILES: Final = 1000

# Least share of a normal that is in a plane: others meet the surface too flatly.
_STEEP: Final = 0.5

# mm that a thick slice may show an edge aside: beyond, a surface is no longer nearly flat in it.
_MOST_DRAWN: Final = 1.5

# Of the finest voxel: distance of samples on a profile, in mm no finer and no coarser.
_SAMPLES: Final = (0.5, 0.4, 1.0)

# What a mm of outside on the way to the edge costs, far off and within so many mm: there muscles
# in the cavity may be crossed where blood is beyond them. Less, and the search leaps over a wall.
FAR_CROSSING: Final = 1.0
NEAR_CROSSING: Final = 0.35
_NEAR: Final = 6.0

# mm that edges of labels are looked for in at least: there is no other edge near them.
_LABEL_REACH: Final = 10.0

# mm beyond the edge, and within it, that say how bright each side is.
_BEYOND: Final = (1.5, 4.5)
_WITHIN: Final = (-6.0, -2.0)

# Voxels that an edge is blurred over, on each side; mm that it may be, for walls are not thicker.
_BLUR: Final = 1.2
_MOST_BLUR: Final = 1.5

# Within it where trabeculae are next to it: blood is beyond them.
_DEEP: Final = (-10.0, -6.0)


@dataclass(frozen=True, eq=False)
class Facets:
    """What of a surface's triangles is the same in all its shapes.

    Parameters
    ----------
    faces : (faces, 3) int64
    edges : modalmotion.mesh.geometry.Edges
    outward : float
        1 where triangles are wound outward, -1 inward.
    vertices : (n,) int64
        Those that profiles through volumes start from, each for an equal share of the area.
    """

    faces: Ints
    edges: MeshEdges
    outward: float
    vertices: Ints

    @staticmethod
    def of(faces: Ints, x: Floats, weights: Floats) -> Facets:
        """Take them from triangles, positions (vertices, 3) and areas (vertices,)."""
        ends = np.cumsum(weights) / weights.sum()
        spread = (np.arange(_N_PROFILES) + 0.5) / _N_PROFILES
        vertices = np.unique(np.searchsorted(ends, spread).clip(0, len(x) - 1))
        outward = 1.0 if float(Cavity(faces).volume(x)) >= 0 else -1.0
        return Facets(faces, MeshEdges.of(faces), outward, vertices)

    def normals(self, x: Floats) -> Floats:
        """Outward unit normals at vertices."""
        normals: Floats = self.outward * vertex_normals(x, self.faces)
        return normals

    def turning(self, x: Floats, normals: Floats) -> Floats:
        """How normals turn along the surface, dn = S dx, by least squares: (vertices, 3, 3)."""
        ends = self.edges.ends
        d, turned = (np.diff(y[ends], axis=1)[:, 0] for y in (x, normals))
        squares, products = np.zeros((2, len(x), 3, 3))
        for k in range(2):
            np.add.at(squares, ends[:, k], d[:, :, None] * d[:, None])
            np.add.at(products, ends[:, k], turned[:, :, None] * d[:, None])
        size = np.trace(squares, axis1=1, axis2=2)[:, None, None]
        squares += np.where(size > 0, size, 1.0) * (
            normals[:, :, None] * normals[:, None] + 1e-3 * np.eye(3)
        )
        return np.asarray(products @ np.linalg.inv(squares), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Imaging:
    """Brightness, bias field and displaced planes of images, anchored at the reference.

    Parameters
    ----------
    levels : Levels
    slope : (3,) float64, 1 / mm
        Of the bias field, a gain of 1 at `middle`.
    middle : (3,) float64, mm
    shifts : (planes, 3) float64, mm
        By which each plane shows everything aside from its place.
    shift_sd : float, mm
        Of a shift along each axis of its plane, before the images.
    crossing : float
        See `find_edges`.
    valve : ((3,) float64, float), optional
        Axis to the base, and how high along it, mm, edges may be: the wall of an atrium goes on.
    has_layers : bool
        Whether layers of trabeculae are next to the edges: see `Levels.faint_layer`.
    """

    levels: Levels
    slope: Floats
    middle: Floats
    shifts: Floats
    shift_sd: float = 2.0
    crossing: float = FAR_CROSSING
    valve: tuple[Floats, float] | None = None
    has_layers: bool = False

    def within(self, reach: float) -> Imaging:
        """Return the same for edges up to `reach` mm away."""
        return replace(self, crossing=FAR_CROSSING if reach > _NEAR else NEAR_CROSSING)

    def gain(self, points: Floats) -> Floats:
        """Gain of the bias field at points (n, 3)."""
        gain: Floats = np.clip(1.0 + (points - self.middle) @ self.slope, 0.4, 1.8)
        return gain


@dataclass(frozen=True, eq=False)
class View:
    """Edges that were found near a shape.

    Parameters
    ----------
    feet : (n, 3) int64
    shares : (n, 3) float64
    starts : (n, 3) float64, mm
        Of the profiles, on the surface.
    directions : (n, 3) float64
        Of the profiles: the surface's normals, or their parts in a plane.
    normals : (n, 3) float64
        Of the surface.
    planes : (n,) int64
        Plane of each, 0 in a volume.
    weights : (n,) float64
        By the surface that each represents.
    extents : (n,) float64, mm
        Of a voxel along each.
    drawn : (n,) float64, mm
        How far inward a thick slice shows the edge of a curved surface.
    profiles : (n, samples) float64
    offsets : (samples,) float64, mm
    edges : Edges
    """

    feet: Ints
    shares: Floats
    starts: Floats
    directions: Floats
    normals: Floats
    planes: Ints
    weights: Floats
    extents: Floats
    drawn: Floats
    profiles: Floats
    offsets: Floats
    edges: Edges

    @property
    def found(self) -> float:
        """Share of the profiles in the field of view that have an edge."""
        there = np.isfinite(self.profiles).mean(axis=1) > 0.5
        return float(self.edges.is_found[there].mean()) if there.any() else 0.0

    def observation(self) -> Observation:
        """Rows for the estimate: how far the surface is from each edge along its normal."""
        k = self.edges.is_found
        return Observation(
            self.starts[k] + self.edges.offsets[k, None] * self.directions[k],
            weights=self.weights[k] * self.edges.steps[k],
            normals=self.normals[k],
            feet=self.feet[k],
            shares=self.shares[k],
        )

    def beside(self, *, is_deep: bool) -> tuple[Floats, Floats]:
        """Mean brightness within and beyond each edge that was found, within far from it or not."""
        k = self.edges.is_found
        away = self.offsets[None] - self.edges.offsets[k, None]
        own, blurred = (
            self.profiles[k],
            np.clip(_BLUR * self.extents[k, None] - _BEYOND[0], 0.0, _MOST_BLUR),
        )
        within = _DEEP if is_deep else _WITHIN
        return _mean_in(own, away + blurred, *within), _mean_in(own, away - blurred, *_BEYOND)


def view_of(
    image: Image,
    facets: Facets,
    x: Floats,
    imaging: Imaging,
    reach: float,
    *,
    layers: Literal["distinct", "faint"] = "faint",
) -> View:
    """Look for edges up to `reach` mm on both sides of a surface, (vertices, 3) mm.

    Parameters
    ----------
    image : Volume or PlaneSet
    facets : Facets
    x : (vertices, 3) float64, mm
    imaging : Imaging
    reach : float, mm
    layers : {"distinct", "faint"}
        Which ones are told from blood, where the imaging knows any.
    """
    if imaging.levels.is_labelled:
        reach = max(reach, _LABEL_REACH)
    if isinstance(image, Volume):
        view = _through_volume(image, facets, x, reach)
    else:
        view = _in_planes(image, facets, x, imaging.shifts, reach)
    like = imaging.levels.likeness(view.profiles, imaging.gain(view.starts)[:, None])
    step = float(view.offsets[1] - view.offsets[0])
    layer = imaging.levels.layer if layers == "distinct" else imaging.levels.faint_layer
    layer = layer if imaging.has_layers else -np.inf
    edges = find_edges(like, step, reach, view.extents, imaging.crossing, layer)
    if not imaging.levels.is_labelled:
        edges = edges._replace(offsets=edges.offsets + view.drawn)
    # Most of what an edge is judged by must be in the field of view.
    near = np.abs(view.offsets[None] - edges.offsets[:, None]) < 3.0
    seen = (np.isfinite(view.profiles) | ~near).all(axis=1)
    places = view.starts + edges.offsets[:, None] * view.directions
    if imaging.valve is not None:
        axis, highest = imaging.valve
        seen &= places @ axis <= highest
    return replace(view, edges=edges._replace(is_found=edges.is_found & seen))


def _through_volume(volume: Volume, facets: Facets, x: Floats, reach: float) -> View:
    v, n = facets.vertices, len(facets.vertices)
    normals = facets.normals(x)[v]
    offsets = offsets_of(_step(volume.spacing), reach)
    return View(
        np.repeat(v[:, None], 3, axis=1),
        np.tile([1.0, 0.0, 0.0], (n, 1)),
        x[v],
        normals,
        normals,
        np.zeros(n, dtype=np.int64),
        np.ones(n),
        volume.extents(normals),
        np.zeros(n),
        _sampled(volume, x[v], normals, offsets),
        offsets,
        _none(n),
    )


def _in_planes(planes: PlaneSet, facets: Facets, x: Floats, shifts: Floats, reach: float) -> View:
    normals_at = facets.normals(x)
    turning = facets.turning(x, normals_at)
    offsets = offsets_of(_step([min(plane.spacing) for plane in planes.planes]), reach)
    parts = []
    for k, plane in enumerate(planes.planes):
        cut = facets.edges.cut(x, plane.heights(x))
        normals = (cut.shares[:, :, None] * normals_at[cut.corners]).sum(axis=1)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        inside = normals - (normals @ plane.normal)[:, None] * plane.normal
        size = np.linalg.norm(inside, axis=1)
        kept = (size > _STEEP) & (cut.lengths > 0)
        corners, shares = cut.corners[kept], cut.shares[kept]
        starts = (shares[:, :, None] * x[corners]).sum(axis=1)
        directions = inside[kept] / size[kept, None]
        n, b = len(starts), size[kept]
        # A slice of the thickness h is the mean over y across it. The surface n . p + p'Sp / 2 = 0
        # is at t = -y a / b - y^2 v'Sv / 2 b along its direction e, a = n . m, b = n . e,
        # v = m - e a / b; and y^2 is h^2 / 12 in the mean.
        S = (shares[:, :, None, None] * turning[corners]).sum(axis=1)
        along = plane.normal - directions * ((normals[kept] @ plane.normal) / b)[:, None]
        drawn = plane.thickness**2 / 24.0 * np.einsum("ni,nij,nj->n", along, S, along) / b
        parts.append(
            (
                np.concatenate([corners, corners[:, :1]], axis=1),
                np.concatenate([shares, np.zeros((n, 1))], axis=1),
                starts,
                directions,
                normals[kept],
                np.full(n, k),
                cut.lengths[kept],
                np.full(n, max(plane.spacing)),
                np.clip(drawn, -_MOST_DRAWN, _MOST_DRAWN),
                _sampled(plane, starts + shifts[k], directions, offsets),
            )
        )
    joined = (np.concatenate(each) for each in zip(*parts, strict=True))
    view = View(*joined, offsets, _none(0))  # type: ignore[call-arg]
    n = len(view.weights)
    weights = view.weights * n / max(float(view.weights.sum()), 1e-300)
    return replace(view, weights=weights, edges=_none(n))


def _none(n: int) -> Edges:
    return Edges(np.zeros(n), np.zeros(n), np.zeros(n, dtype=np.bool_), np.ones(n))


def _step(spacing: Sequence[float]) -> float:
    share, least, most = _SAMPLES
    return float(np.clip(share * min(spacing), least, most))


def _sampled(image: Volume | Plane, starts: Floats, directions: Floats, offsets: Floats) -> Floats:
    points = starts[:, None] + offsets[:, None] * directions[:, None]
    return image.sample(points.reshape(-1, 3)).reshape(len(starts), len(offsets))


def _mean_in(values: Floats, away: Floats, low: float, high: float) -> Floats:
    there = (away >= low) & (away <= high) & np.isfinite(values)
    total = np.where(there, values, 0.0).sum(axis=1)
    mean: Floats = np.where(there.any(axis=1), total / np.maximum(there.sum(axis=1), 1), np.nan)
    return mean
