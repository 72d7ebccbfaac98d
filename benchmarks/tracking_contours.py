"""Tracking of contours: real ones, and sections of simulated ventricles whose base leans."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from measure import Table
from numpy.typing import NDArray
from real_data import DATA, recording
from tracking_truth import ejection_fraction, timed

from modalmotion.mesh import cavity_of
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.simulate import simulate_cohort
from modalmotion.template import make_template
from modalmotion.tracking import Observation, Track, track
from modalmotion.tracking.closest import closest_points
from modalmotion.tracking.parameters import TrackParameters
from modalmotion.tracking.reading import read_observed

N_CASES = 20

# Of the base against the axis, as of a valve; between slices; between points; and noise, mm.
TILT = np.radians(15.0)
SPACING, STEP, NOISE = 15.0, 2.5, 0.7

# In-plane shift of each slice, of breaths held unlike, mm.
SHIFT = 0.5

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def real_contours() -> Table:
    """Contours of real cine images, and the mesh that others fitted to them."""
    table = Table("Real contours, 25 phases, 37 modes", ("figure", "value"))
    recorded = read_observed(DATA / "cine" / "contours")
    result, seconds = timed(lambda: TrackParameters(topology="cup", unit="mm").follow(recorded))
    theirs = recording("heart/lv_endocardium")
    points = [frame[0].points for frame in recorded.frames]
    volumes = _volumes(theirs)
    assert result.volumes is not None
    off = _distance(points, result.sequence)
    # From frame 0 to the smallest volume, as the figure of the fitted mesh is given.
    own, other = (100 * (1 - v.min() / v[0]) for v in (result.volumes, volumes))
    r = float(np.corrcoef(result.volumes, volumes)[0, 1])
    table.add_at_most(off, 0.90, "mean distance to the contours, mm", f"{off:.3f}")
    table.add("the fitted mesh's", f"{_distance(points, theirs):.3f}")
    text = f"{own - other:+.2f} of {other:.1f}"
    table.add_at_most(abs(own - other), 1.5, "EF beside the fitted mesh's, points", text)
    table.add_at_least(r, 0.99, "correlation of volumes", f"{r:.4f}")
    table.add("s a frame", f"{seconds / result.n_frames:.3f}")
    return table


def simulated_contours() -> Table:
    """Short- and long-axis sections of simulated ventricles: valves as points, and as a middle."""
    table = Table(
        f"Contours of {N_CASES} simulated ventricles whose base leans by 15 degrees",
        ("valves", "EF off, mean", "worst", "inside its bound", "surface mm"),
    )
    cases = list(_cases(N_CASES))
    for name in ("points of the rim", "their middle"):
        off, within, apart = [], [], []
        for case in cases:
            result = track(case.frames(by_points=name.startswith("points")), topology="cup")
            fraction, bound = result.ejection_fraction, result.ejection_fraction_bound
            assert fraction is not None
            assert bound is not None
            off.append(fraction - case.ejection_fraction)
            within.append(abs(off[-1]) <= bound)
            apart.append(case.apart(result))
        worst = float(np.abs(off).max())
        cells = (
            name,
            f"{np.mean(off):+.2f}",
            f"{worst:.2f}",
            f"{np.mean(within):.0%}",
            f"{np.mean(apart):.3f}",
        )
        if name.startswith("points"):
            table.add_at_most(worst, 2.0, *cells)
        else:
            table.add(*cells)
    return table


@dataclass(frozen=True)
class Case:
    """A ventricle, and its sections in planes that stay where they are."""

    vertices: Floats
    faces: Ints
    contours: list[Floats]
    valves: list[Floats]
    apex: Floats

    def frames(self, *, by_points: bool) -> list[list[Observation]]:
        """Contours, valves and the first frame's apex."""
        frames = []
        for points, valve in zip(self.contours, self.valves, strict=True):
            base = Observation(valve, end="base")
            if not by_points:
                base = Observation(valve.mean(axis=0)[None], places=("base",))
            frames.append([Observation(points), base])
        frames[0].append(Observation(self.apex, places=("apex",)))
        return frames

    @property
    def ejection_fraction(self) -> float:
        """Percent."""
        return ejection_fraction(self.vertices, self.faces)

    def apart(self, result: Track) -> float:
        """Mean distance of the true vertices from the surface, mm."""
        return _distance(list(self.vertices), result.sequence)


def _cases(n: int) -> Iterator[Case]:
    for k, one in enumerate(simulate_cohort(-(-n // 5), rng=np.random.default_rng(31), noise=0.0)):
        if k < n:
            yield _case(one.sequence, np.random.default_rng(31 + k))


def _case(sequence: MeshSequence, rng: np.random.Generator) -> Case:
    template = make_template(sequence)
    s, faces = template.coordinates[:, 0], template.faces
    openings = cavity_of(faces, template.n_vertices).openings
    sides = max(openings, key=lambda edges: float(s[np.unique(edges)].mean()))
    rim, tip = np.unique(sides), int(s.argmin())
    x = sequence.vertices[::3].astype(np.float64)
    for frame in x:
        axis = frame[rim].mean(axis=0) - frame[tip]
        long_axis = float(np.linalg.norm(axis))
        axis /= long_axis
        r = frame - frame[tip]
        across = np.cross(axis, (0.2, 0.9, 0.1))
        across /= np.linalg.norm(across)
        height = np.maximum(r @ axis / long_axis, 0.0) ** 3
        frame += (np.tan(TILT) * (r @ across) * height)[:, None] * axis
    middle = x[0][rim].mean(axis=0) - x[0][tip]
    length = float(np.linalg.norm(middle))
    axis = middle / length
    first = np.cross(axis, (0.3, 0.5, 0.7))
    first /= np.linalg.norm(first)
    second, turn = np.cross(axis, first), rng.uniform(0.0, np.pi)
    heights = np.arange(rng.uniform(0.0, SPACING), length, SPACING)
    short = [(x[0][tip] + h * axis, axis) for h in heights]
    angles = turn + np.arange(3) * np.pi / 3
    long = [(x[0][tip], np.cos(a) * first + np.sin(a) * second) for a in angles]
    shifts = [_in_plane(rng.normal(0.0, SHIFT, (1, 3)), n) for _, n in (*short, *long)]
    contours, valves = [], []
    for frame in x:
        rows = []
        for (origin, normal), shift in zip((*short, *long), shifts, strict=True):
            rows.append(_section(frame, faces, origin, normal, rng) + shift)
            rows[-1] += _in_plane(rng.normal(0.0, NOISE, rows[-1].shape), normal)
        contours.append(np.concatenate(rows))
        ends = []
        for (origin, normal), shift in zip(long, shifts[len(short) :], strict=True):
            points = _crossings(frame, sides, origin, normal)
            ends.append(points + shift + _in_plane(rng.normal(0.0, 1.0, points.shape), normal))
        valves.append(np.concatenate(ends))
    apex = x[0][[tip]] + rng.normal(0.0, 1.0, (1, 3))
    return Case(x, faces, contours, valves, apex)


def _crossings(x: Floats, sides: Ints, origin: Floats, normal: Floats) -> Floats:
    """Where sides of triangles pass through a plane."""
    height = (x - origin) @ normal
    a, b = sides[height[sides].prod(axis=1) < 0].T
    t = height[a] / (height[a] - height[b])
    points: Floats = x[a] + t[:, None] * (x[b] - x[a])
    return points


def _section(
    x: Floats, faces: Ints, origin: Floats, normal: Floats, rng: np.random.Generator
) -> Floats:
    """Points of a surface in a plane, evenly along the section."""
    height = (x - origin) @ normal
    cut = faces[(height[faces].min(axis=1) < 0) & (height[faces].max(axis=1) > 0)]
    if not len(cut):
        return np.zeros((0, 3))
    ends = []
    for face in cut:
        pair = _crossings(x, face[[[0, 1], [1, 2], [2, 0]]], origin, normal)
        if len(pair) == 2:
            ends.append(pair)
    pairs = np.array(ends)
    reach = np.cumsum(np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1))
    n = max(3, round(float(reach[-1]) / STEP))
    piece = np.searchsorted(reach, (np.arange(n) + 0.5) / n * reach[-1])
    t = rng.uniform(0.0, 1.0, (n, 1))
    points: Floats = (1.0 - t) * pairs[piece, 0] + t * pairs[piece, 1]
    return points


def _in_plane(moves: Floats, normal: Floats) -> Floats:
    flat: Floats = moves - (moves @ normal)[:, None] * normal
    return flat


def _distance(points: list[Floats], sequence: MeshSequence) -> float:
    """Mean distance of the points of each frame from its surface."""
    off = [
        closest_points(y, x.astype(np.float64), sequence.faces).distances.mean()
        for y, x in zip(points, sequence.vertices, strict=True)
    ]
    return float(np.mean(off))


def _volumes(sequence: MeshSequence) -> Floats:
    cavity = cavity_of(sequence.faces, sequence.n_vertices)
    volumes: Floats = np.abs(cavity.volume(sequence.vertices.astype(np.float64)))
    return volumes
