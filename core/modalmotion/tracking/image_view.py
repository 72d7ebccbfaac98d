"""What an image shows of a surface: edges on profiles, and how bright both sides are."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from modalmotion import errors, mesh
from modalmotion.images import Plane, PlaneSet, Volume
from modalmotion.images.volume import Image
from modalmotion.mesh.geometry import Edges as MeshEdges
from modalmotion.mesh.geometry import vertex_normals
from modalmotion.representation import Bools, Floats, Ints, shown
from modalmotion.tracking.closest import across
from modalmotion.tracking.observation import Observation

# mm within and beyond an edge that must look like inside and like outside. A wall is thicker.
INNER: Final = 6.0
OUTER: Final = 4.0

# Of the contrast: step of the mean brightness over 3 mm on both sides that makes an edge.
_LEAST_STEP: Final = 0.4
_BESIDE: Final = 3.0

# Likeness of what is next to an edge on its inner side: less is a layer of blood and muscle, and
# the edge is in the middle between the layer and the outside. One that is told from an edge's
# blur, and any where trabeculae are known to be; what it is at least, and how many times the noise
# of one sample it must be below that of blood.
DISTINCT: Final = 0.45
FAINT: Final = 0.7
_DARKEST: Final = -0.2
_NOISES: Final = 1.8

# No image has more contrast.
_LABELLED: Final = 1e6

# Per mm: a nearer edge is preferred to one as good farther away.
_NEARER: Final = 0.03


@shown()
@dataclass(frozen=True)
class Levels:
    """Brightness on both sides of a surface.

    Parameters
    ----------
    inside, outside : float
    spread : float
        Standard deviation of noise on one side.
    """

    inside: float
    outside: float
    spread: float

    @property
    def contrast(self) -> float:
        """Difference of both sides over the spread within one."""
        return abs(self.inside - self.outside) / max(self.spread, 1e-300)

    @property
    def is_labelled(self) -> bool:
        """Whether values are labels, which have no noise and are not means over a slice."""
        return self.contrast > _LABELLED

    def layer(self, likeness: float) -> float:
        """Likeness next to an edge below which there is a layer, not noise: at most the one given.

        Labels have no noise, and no layer.
        """
        if self.is_labelled:
            return -np.inf
        # Noise of one sample, as likeness.
        return min(likeness, 1.0 - _NOISES * 2.0 / max(self.contrast, 1e-300))

    def likeness(self, values: Floats, gain: Floats | float = 1.0) -> Floats:
        """How far values are like the inside (1), the outside (-1), or between; NaN is 0.

        Parameters
        ----------
        values : (...) float64
        gain : (...) float64
            Of the bias field: by which both levels are multiplied.
        """
        half = (self.inside - self.outside) / 2.0
        middle = (self.inside + self.outside) / 2.0
        like: Floats = np.nan_to_num((values / gain - middle) / half, nan=0.0)
        return like


class Edges(NamedTuple):
    """One edge on each profile.

    Parameters
    ----------
    offsets : (n,) float64, mm
    steps : (n,) float64
        Of the mean brightness there, 1 for the whole contrast.
    is_found : (n,) bool
    inside : (n,) float64
        Likeness of what is next to it on its inner side: 1 of blood, less of a layer of muscle
        and blood.
    """

    offsets: Floats
    steps: Floats
    is_found: Bools
    inside: Floats


def find_edges(
    likeness: Floats,
    step: float,
    reach: float,
    extents: Floats,
    crossing: float,
    layer: float = -np.inf,
) -> Edges:
    """Find the edge on each profile: the best split into an inside and an outside.

    Parameters
    ----------
    likeness : (n, samples) float64
        Of profiles from -reach - INNER to reach + OUTER, as `offsets_of` spreads them.
    step : float, mm
    reach : float, mm
    extents : (n,) float64, mm
        Of a voxel along each profile.
    crossing : float
        What a mm of outside on the way from the inside costs, in mm of inside: small where
        structures within the cavity, as papillary muscles, belong to it.
    layer : float
        See `Levels.layer`.

    Notes
    -----
    All up to the edge is inside, OUTER beyond it outside. The place between two samples comes
    from the area under the profile next to the edge, which noise moves least: w (a + b) + x (a - b)
    is that between levels a and b, x beyond the middle. b is the outside's, -1; a is 1, or where a
    layer of trabeculae is next to the edge that layer's.
    """
    n, m = likeness.shape
    a, b = round(INNER / step), round(OUTER / step)
    c = np.clip(likeness, -1.0, 1.0)
    up_to = sums_of(np.where(c > 0, c, crossing * c)) * step
    whole = sums_of(c) * step
    j = np.arange(a, m - b)
    d = (j - a) * step - reach - step / 2
    score = up_to[:, j] - (whole[:, j + b] - whole[:, j]) - _NEARER * np.abs(d)
    k = score.argmax(axis=1)
    rows = np.arange(n)
    beside = min(a, b, max(1, round(_BESIDE / step)))
    at = j[k]
    inner = (whole[rows, at] - whole[rows, at - beside]) / (beside * step)
    outer = (whole[rows, at + beside] - whole[rows, at]) / (beside * step)
    steps = (inner - outer) / 2.0
    is_found = (k > 0) & (k < len(j) - 1) & (steps > _LEAST_STEP)
    # Area: of a window 2 w around the split a share (1 + mean) / 2 is inside.
    w = np.clip(np.rint((1.5 * extents + 1.0) / step).astype(np.int64), 1, min(a, b))
    wide = sums_of(np.clip(likeness, -1.5, 1.5)) * step
    area = wide[rows, at + w] - wide[rows, at - w]
    # Farther half of the window: nearer to the edge is its blur.
    half = (w + 1) // 2
    beside_it = (wide[rows, at - half] - wide[rows, at - w]) / (np.maximum(w - half, 1) * step)
    is_layer = (beside_it < layer) & (half < w)
    inside = np.where(is_layer, np.maximum(beside_it, _DARKEST), 1.0)
    x = (area - w * step * (inside - 1.0)) / (inside + 1.0)
    return Edges(d[k] + x, np.clip(steps, 0.0, 1.0), is_found, inside)


def offsets_of(step: float, reach: float) -> Floats:
    """Spread the samples of a profile for `find_edges`, (samples,) float64, mm."""
    n = round(2 * reach / step) + 1
    a, b = round(INNER / step), round(OUTER / step)
    return np.asarray(-reach + step * np.arange(-a, n + b), dtype=np.float64)


def sums_of(values: Floats) -> Floats:
    """Sum the first 0, 1, ... samples, (n, samples + 1)."""
    sums = np.zeros((len(values), values.shape[1] + 1))
    np.cumsum(values, axis=1, out=sums[:, 1:])
    return sums


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
    def of(faces: Ints, x: Floats, weights: Floats) -> "Facets":
        """Take them from triangles, positions (vertices, 3) and areas (vertices,)."""
        ends = np.cumsum(weights) / weights.sum()
        spread = (np.arange(_N_PROFILES) + 0.5) / _N_PROFILES
        vertices = np.unique(np.searchsorted(ends, spread).clip(0, len(x) - 1))
        outward = 1.0 if float(mesh.Cavity(faces).volume(x)) >= 0 else -1.0
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
    layers : float
        Likeness of the layers of trabeculae that are next to the edges: `DISTINCT` or `FAINT`; by
        default there are none.
    """

    levels: Levels
    slope: Floats
    middle: Floats
    shifts: Floats
    shift_sd: float = 2.0
    crossing: float = FAR_CROSSING
    valve: tuple[Floats, float] | None = None
    layers: float = -np.inf

    @property
    def has_layers(self) -> bool:
        """Whether layers of trabeculae are next to the edges."""
        return self.layers > -np.inf

    def within(self, reach: float) -> "Imaging":
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
        blurred = np.clip(_BLUR * self.extents[k, None] - _BEYOND[0], 0.0, _MOST_BLUR)
        sides = (away + blurred, _DEEP if is_deep else _WITHIN), (away - blurred, _BEYOND)
        inner, outer = (_mean_in(self.profiles[k], at, *window) for at, window in sides)
        return inner, outer


def view_of(image: Image, facets: Facets, x: Floats, imaging: Imaging, reach: float) -> View:
    """Look for edges up to `reach` mm on both sides of a surface, (vertices, 3) mm.

    Parameters
    ----------
    image : Volume or PlaneSet
    facets : Facets
    x : (vertices, 3) float64, mm
    imaging : Imaging
    reach : float, mm
    """
    if imaging.levels.is_labelled:
        reach = max(reach, _LABEL_REACH)
    if isinstance(image, Volume):
        view = _through_volume(image, facets, x, reach)
    else:
        view = _in_planes(image, facets, x, imaging.shifts, reach)
    like = imaging.levels.likeness(view.profiles, imaging.gain(view.starts)[:, None])
    step = float(view.offsets[1] - view.offsets[0])
    layer = imaging.levels.layer(imaging.layers)
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


# Of profiles whose edges are still to be found.
_UNSEEN: Final = Edges(*np.zeros((4, 0)))


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
        _UNSEEN,
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
    view = View(*joined, offsets, _UNSEEN)  # type: ignore[call-arg]
    weights = view.weights * len(view.weights) / max(float(view.weights.sum()), 1e-300)
    return replace(view, weights=weights)


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


# Heights along the axis, and turns about it, of the rays; of planes each has its own height.
_HEIGHTS: Final = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
_N_TURNS: Final = 32

# mm: samples on rays, and windows on both sides of an edge.
_STEP: Final = 0.8
_INNER: Final = 5.0
_OUTER: Final = 3.5

# mm from apex to base. Windows are some mm wide.
_SHORTEST: Final = 20.0

# Of the usual greatest step on a ray: the first step so large is the edge.
_FIRST: Final = 0.6

# Least share of rays that agree on the sign, and least contrast.
_LEAST_AGREED: Final = 0.55
_LEAST_CONTRAST: Final = 0.8

# Of the contrast: how far a frame's levels may be from those of the reference.
_APART: Final = 0.1

# mm inside an edge, from and to, that noise is looked for in.
_NOISE_AT: Final = (9.0, 2.0)

# Normal deviation over the median one.
_PER_MEDIAN: Final = 1.4826


def first_sight(image: Image, apex: Floats, base: Floats, frame: int) -> tuple[Levels, Floats]:
    """Find the brightness on both sides by rays outward from the axis between two landmarks.

    Returns
    -------
    Levels
    (n, 3) float64, mm
        Where rays first met an edge.

    Raises
    ------
    ShapeError
        Where nothing is in the field of view, all is alike, or rays meet no common edge.
    """
    length = float(np.linalg.norm(base - apex))
    if length < _SHORTEST:
        raise errors.ShapeError(
            f"Apex and base are {length:.3g} mm apart in frame {frame}; tracking looks for walls "
            f"a few mm thick, in objects of {_SHORTEST:g} mm or more.",
            remedy="Give apex and base in LPS mm; for a smaller object, enlarge the spacing and "
            "scale the result back.",
            frame=frame,
            details={"length": length, "least": _SHORTEST},
        )
    offsets: Floats = np.arange(0.0, 0.6 * length + _OUTER, _STEP).astype(np.float64)
    starts, directions, profiles = _rays(image, apex, base, offsets)
    there = np.isfinite(profiles).mean(axis=1) > 0.6
    if there.sum() < _N_TURNS:
        raise errors.ShapeError(
            f"The object is outside the images of frame {frame}: {int(there.sum())} of "
            f"{len(there)} rays from its axis are in the field of view.",
            remedy="Give apex and base in the LPS coordinates of these images, in mm (in RAS, x "
            "and y have the opposite sign).",
            frame=frame,
        )
    v, starts, directions = profiles[there], starts[there], directions[there]
    v = np.where(np.isfinite(v), v, np.nanmedian(v, axis=1, keepdims=True))
    a, b = round(_INNER / _STEP), round(_OUTER / _STEP)
    sums = sums_of(v)
    j = np.arange(a, v.shape[1] - b)
    inner = (sums[:, j + 1] - sums[:, j + 1 - a]) / a
    outer = (sums[:, j + 1 + b] - sums[:, j + 1]) / b
    step = np.abs(inner - outer)
    usual = float(np.median(step.max(axis=1)))
    if not usual > 1e-9 * float(np.abs(v).max(initial=0.0)):
        raise _no_contrast(frame, 0.0)
    first = (step > _FIRST * usual).argmax(axis=1)
    rows = np.arange(len(v))
    reach = round(5.0 / _STEP)
    near = np.minimum(first[:, None] + np.arange(reach), len(j) - 1)
    k = near[rows, step[rows[:, None], near].argmax(axis=1)]
    A, B = inner[rows, k], outer[rows, k]
    is_edge = step[rows, k] > _FIRST * usual
    sign = np.sign(np.median((A - B)[is_edge])) if is_edge.any() else 1.0
    agrees = is_edge & (np.sign(A - B) == sign)
    noise = _PER_MEDIAN * float(np.median(np.abs(np.diff(v, axis=1)))) / np.sqrt(2.0)
    if agrees.mean() < _LEAST_AGREED:
        raise errors.ShapeError(
            f"No object is seen about the axis in frame {frame}: only {agrees.mean():.0%} of the "
            "outward rays meet an edge of the same kind.",
            remedy="Check apex and base, and that both are in the images.",
            frame=frame,
            details={"agreed": float(agrees.mean())},
        )
    inside, outside = float(np.median(A[agrees])), float(np.median(B[agrees]))
    spread = _PER_MEDIAN * float(np.median(np.abs(A[agrees] - inside)))
    levels = Levels(inside, outside, max(spread, noise, 1e-12 * abs(inside - outside)))
    if levels.contrast < _LEAST_CONTRAST:
        raise _no_contrast(frame, levels.contrast)
    places = starts[agrees] + (j[k[agrees]] + 0.5)[:, None] * _STEP * directions[agrees]
    return levels, places


def renewed(imaging: Imaging, view: View) -> Imaging:
    """Find levels and bias field next to the edges that a view found: linear in place.

    Where layers are next to the edges, blood is looked for beyond them.
    """
    inner, outer = view.beside(is_deep=imaging.has_layers)
    x = view.starts[view.edges.is_found] - imaging.middle
    ok = np.isfinite(inner) & np.isfinite(outer)
    if ok.sum() < 4 * _N_TURNS:
        return imaging
    inner, outer, x = inner[ok], outer[ok], x[ok]
    spread = _spread(view)
    gain = 1.0 + x @ imaging.slope
    # Labels have no noise: all errors of more than a thousandth count alike.
    least = 1e-3 * abs(imaging.levels.inside - imaging.levels.outside)
    inside, outside, slope = imaging.levels.inside, imaging.levels.outside, imaging.slope
    for _ in range(4):
        inside, outside = float(np.median(inner / gain)), float(np.median(outer / gain))
        # Both sides, I (1 + c x) and O (1 + c x): c by least absolute deviations, reweighted.
        rows = np.concatenate([inside * x, outside * x])
        left = np.concatenate([inner - inside, outer - outside])
        r = np.abs(left - rows @ slope)
        w = 1.0 / np.maximum(r, max(0.1 * float(np.median(r)), least))
        ridge = 1e-3 * float((w[:, None] * rows * rows).sum()) / 3.0 * np.eye(3)
        slope = np.linalg.solve(rows.T @ (w[:, None] * rows) + ridge, rows.T @ (w * left))
        gain = np.clip(1.0 + x @ slope, 0.4, 1.8)
    if (inside - outside) * (imaging.levels.inside - imaging.levels.outside) <= 0:
        return imaging
    return replace(imaging, levels=Levels(inside, outside, spread), slope=slope)


def as_bright(imaging: Imaging, view: View) -> Imaging:
    """Find the levels of another frame: contrast agents and gain change from frame to frame.

    Each frame begins anew with the levels of the reference, and leaves them by `_APART` of the
    contrast at most, so that nothing drifts.
    """
    own, found = imaging.levels, renewed(imaging, view).levels
    most = _APART * abs(own.inside - own.outside)
    inside = own.inside + float(np.clip(found.inside - own.inside, -most, most))
    outside = own.outside + float(np.clip(found.outside - own.outside, -most, most))
    return replace(imaging, levels=Levels(inside, outside, own.spread))


def _spread(view: View) -> float:
    """Deviation of noise: of samples from the mean of those 1.5 voxels nearer and farther.

    Blood of many brightnesses, muscles within it and a bias field change from place to place by
    more than that, and are no noise; but over some mm they change evenly.
    """
    k = view.edges.is_found
    away = view.offsets[None] - view.edges.offsets[k, None]
    far, near = _NOISE_AT
    own = np.where((away > -far) & (away < -near), view.profiles[k], np.nan)
    # Between voxels neighbours are interpolated from the same ones.
    step = float(view.offsets[1] - view.offsets[0])
    voxels = min(1.5 * float(np.median(view.extents[k])), (far - near) / 2.0 - step)
    apart = max(1, int(voxels / step))
    n = own.shape[1] - 2 * apart
    left = own[:, apart : apart + n] - (own[:, :n] + own[:, 2 * apart :]) / 2.0
    # The mean of two has half the variance.
    spread = _PER_MEDIAN * float(np.nanmedian(np.abs(left))) / float(np.sqrt(1.5))
    return max(spread, 1e-12 * max(1.0, abs(float(np.nanmedian(own)))))


def _rays(
    image: Image, apex: Floats, base: Floats, offsets: Floats
) -> tuple[Floats, Floats, Floats]:
    """Sample rays from the axis: starts and directions (n, 3) and profiles (n, samples).

    In planes that the axis goes through they start from there.
    """
    axis, cuts = base - apex, list[tuple[float, Floats, Volume | Plane]]()
    along = axis / np.linalg.norm(axis)
    if isinstance(image, Volume):
        cuts = [(share, along, image) for share in _HEIGHTS]
    else:
        for plane in image.planes:
            low, high = plane.heights(np.stack([apex, base]))
            share = low / (low - high) if low != high else -1.0
            if abs(float(plane.normal @ along)) >= 0.7 and 0.1 <= share <= 0.9:
                cuts.append((share, plane.normal, plane))
    starts = np.repeat([apex + share * axis for share, *_ in cuts] or np.zeros((0, 3)), _N_TURNS, 0)
    angles = 2.0 * np.pi * np.arange(_N_TURNS) / _N_TURNS
    turns = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    directions = np.concatenate([np.zeros((0, 3)), *(turns @ across(n) for _, n, _ in cuts)])
    points = starts[:, None] + offsets[:, None] * directions[:, None]
    points = points.reshape(len(cuts), _N_TURNS * len(offsets), 3)
    values = [part.sample(own) for (*_, part), own in zip(cuts, points, strict=True)]
    return starts, directions, np.reshape(values, (len(starts), len(offsets)))


def _no_contrast(frame: int, contrast: float) -> errors.ShapeError:
    return errors.ShapeError(
        f"The images of frame {frame} have no contrast about the axis from apex to base: the two "
        f"sides differ by {contrast:.2g} of the noise.",
        remedy="Check apex and base, or take images in which the object stands out.",
        frame=frame,
        details={"contrast": contrast},
    )
