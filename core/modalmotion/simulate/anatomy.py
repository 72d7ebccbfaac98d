"""Surroundings of a simulated ventricle: wall, papillary muscles, right ventricle, atrium, chest.

Each tissue is a signed distance, mm, negative inside, on a coarse lattice that all frames share;
smooth functions are interpolated on it with little loss, so that any image can be taken of it.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from modalmotion.mesh import Cavity, face_areas, face_normals, sequence
from modalmotion.representation import Floats

# mm: of the lattice, and of what is shown around the ventricle.
_STEP: Final = 2.5
_MARGIN: Final = 27.0

# Wall at end diastole, mm; thicker as its surface shrinks, for muscle keeps its volume.
_WALL: Final = 9.0

# mm around the surface in which distances are computed; beyond, they are this large.
_SHOWN: Final = 17.0
_FAR: Final = 34.0

# Papillary muscles at end diastole: azimuth of the root in turns (0 lateral), its height and that
# of the tip, 0 apex to 1 base, place of the tip from the axis to the wall, and radius, mm.
_PAPILLARY: Final = ((0.86, 0.34, 0.64, 0.50, 4.5), (0.17, 0.34, 0.62, 0.52, 4.5))

# Trabeculae: share of muscle between them at end diastole, and height at which they end.
_TRABECULAR: Final = 0.5
_SMOOTH_ABOVE: Final = 0.8

# Right ventricle: half axes, mm, and its middle from the septum.
_RIGHT: Final = ((24.0, 34.0, 36.0), 14.0)
_SEPTUM: Final = 0.5

# Correlation length of the chest's texture, mm.
_TEXTURE: Final = 12.0


@dataclass(frozen=True, eq=False)
class FieldLattice:
    """Regular lattice of fields.

    Parameters
    ----------
    origin : (3,) float64, mm
    shape : (int, int, int)
    """

    origin: Floats
    shape: tuple[int, ...]

    @property
    def points(self) -> Floats:
        """Places, (n, 3) float64, mm."""
        axes = [o + _STEP * np.arange(n) for o, n in zip(self.origin, self.shape, strict=True)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    def at(self, fields: Floats, points: Floats) -> Floats:
        """Interpolate fields (n, fields) at points (m, 3); beyond the lattice as at its border."""
        places = ((points - self.origin) / _STEP).T
        found = [
            scipy.ndimage.map_coordinates(one.reshape(self.shape), places, order=1, mode="nearest")
            for one in fields.T
        ]
        return np.stack(found, axis=1)


@dataclass(frozen=True, eq=False)
class Tissues:
    """Signed distances at one moment, each (n,) float64, mm.

    `muscle` is the share of trabeculae in blood, from 0 to 1.
    """

    cavity: Floats
    wall: Floats
    papillary: Floats
    right: Floats
    atrium: Floats
    muscle: Floats


class Anatomy:
    """The surroundings of a simulated ventricle over its beat.

    Parameters
    ----------
    truth : MeshSequence
        A cup lattice, as `simulate_ventricle` makes it, mm.
    rng : numpy.random.Generator
        Of the chest's texture.
    trabeculae : float, mm
        Depth of a layer of trabeculae at the apex; toward the base it is thinner.
    """

    def __init__(
        self, truth: sequence.MeshSequence, rng: "np.random.Generator", trabeculae: float = 0.0
    ) -> None:
        x = truth.vertices.astype(np.float64)
        low, high = x.min(axis=(0, 1)) - _MARGIN, x.max(axis=(0, 1)) + _MARGIN
        shape = tuple(int(np.ceil(n)) + 1 for n in (high - low) / _STEP)
        self.lattice = FieldLattice(low, shape)
        self._rows = x.reshape(truth.n_frames, *(truth.grid or (0, 0)), 3)
        self._faces, self._trabeculae = truth.faces, trabeculae
        texture = scipy.ndimage.gaussian_filter(rng.normal(size=shape), _TEXTURE / _STEP).ravel()
        self.texture = (texture - texture.min()) / np.ptp(texture)
        self._areas = np.array([face_areas(frame, truth.faces).sum() for frame in x])
        self._outward = float(np.sign(Cavity(truth.faces).volume(x[0])))
        muscles = range(len(_PAPILLARY))
        axes = [[np.subtract(*self._segment(f, k)) for k in muscles] for f in range(len(x))]
        lengths = np.linalg.norm(axes, axis=2)
        # mm by frame and muscle: pi r^2 length stays.
        self._radii = np.array([m[-1] for m in _PAPILLARY]) * np.sqrt(lengths[0] / lengths)

    @property
    def papillary_volume(self) -> float:
        """Of the papillary muscles within the cavity at end diastole, mm^3."""
        first = self.at(0)
        spots = np.concatenate([np.stack(self._segment(0, k)) for k in range(len(_PAPILLARY))])
        reach = float(self._radii[0].max()) + 1.0
        low, high = spots.min(axis=0) - reach, spots.max(axis=0) + reach
        axes = [np.arange(a, b) for a, b in zip(low, high, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        distances = self.lattice.at(np.stack([first.papillary, first.cavity], axis=1), points)
        # Of cubes of 1 mm.
        return float(np.clip(0.5 - distances.max(axis=1), 0.0, 1.0).sum())

    def at(self, frame: int) -> Tissues:
        """Compute all tissues in one frame."""
        p, rows = self.lattice.points, self._rows[frame]
        cavity = self._distance(p, rows)
        wall = cavity - _WALL * self._areas[0] / self._areas[frame]
        papillary = np.full(len(p), _FAR)
        for k in range(len(_PAPILLARY)):
            # A rod with round ends.
            away = np.linalg.norm(p - _foot(p, *self._segment(frame, k)), axis=1)
            papillary = np.minimum(papillary, away - self._radii[frame, k])
        apex, base, axis = _axis_of(rows)
        septum = rows[len(rows) // 2, int(_SEPTUM * rows.shape[1])]
        out = septum - apex - ((septum - apex) @ axis) * axis
        out /= np.linalg.norm(out)
        half, away = _RIGHT
        centre = septum + away * out
        local = (p - centre) @ np.stack([out, np.cross(axis, out), axis], axis=1)
        size = np.linalg.norm(local / np.array(half), axis=1)
        right = np.maximum((size - 1.0) * min(half), -(wall - 1.0))
        up = (p - base) @ axis
        aside = np.linalg.norm(p - base - up[:, None] * axis, axis=1)
        opening = float(np.linalg.norm(rows[-1] - base, axis=1).mean())
        # No edge at the valve: blood continues, as wide as the ring and then wider.
        atrium = np.maximum(-(up + 2.0), aside - opening - 0.3 * np.maximum(up, 0.0))
        muscle = self._muscle(frame, cavity, 1.0 + up / float(np.linalg.norm(base - apex)))
        return Tissues(cavity, wall, papillary, right, atrium, muscle)

    @property
    def trabecular_volume(self) -> float:
        """Of the muscle in trabeculae at end diastole, mm^3."""
        first = self.at(0)
        inside = np.clip(0.5 - first.cavity / _STEP, 0.0, 1.0)
        return float((inside * first.muscle).sum()) * _STEP**3

    def _muscle(self, frame: int, cavity: Floats, heights: Floats) -> Floats:
        """Share of muscle between trabeculae: it keeps its volume as their layer shrinks."""
        if self._trabeculae <= 0:
            return np.zeros(len(cavity))
        # All of it is compact before it would be more than whole.
        share = min(1.0, _TRABECULAR * float(self._areas[0] / self._areas[frame]))
        depth = self._trabeculae * np.clip(1.0 - heights / _SMOOTH_ABOVE, 0.0, 1.0)
        inner = np.clip(0.5 + (cavity + depth) / _STEP, 0.0, 1.0) * np.minimum(depth / _STEP, 1.0)
        found: Floats = share * inner * (heights < 1.0)
        return found

    def _distance(self, p: Floats, rows: Floats) -> Floats:
        """Signed distance from the closed surface, by the nearest of many places on it."""
        faces, x = self._faces, rows.reshape(-1, 3)
        a, b, c = (x[faces[:, i]] for i in range(3))
        shares = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4], [2, 2, 2]]) / 6.0
        spots = [s[0] * a + s[1] * b + s[2] * c for s in shares]
        normals = face_normals(x, faces) * self._outward
        size = np.linalg.norm(normals, axis=1)
        proper = size > 0
        normals = normals[proper] / size[proper, None]
        apex, base, up = _axis_of(rows)
        ring = rows[-1]
        lid = [base + t * (ring - base) for t in np.linspace(0.1, 0.95, 12)]
        places = np.concatenate([*(s[proper] for s in spots), *lid])
        across = np.concatenate([*[normals] * 4, np.tile(up, (12 * len(ring), 1))])
        # The chest is far away; its distance is not needed.
        reach = float(np.linalg.norm(x - _foot(x, apex, base), axis=1).max()) + _SHOWN
        signed = np.full(len(p), _FAR)
        near = np.flatnonzero(np.linalg.norm(p - _foot(p, base - 200.0 * up, base), axis=1) < reach)
        d, k = scipy.spatial.cKDTree(places).query(p[near])
        gap = p[near] - places[k]
        along = (gap * across[k]).sum(axis=1)
        # Near a place the plane through it is more accurate than the distance to it.
        signed[near] = np.where(d < 2.0 * _STEP, along, np.sign(along) * d)
        return signed

    def _segment(self, frame: int, k: int) -> tuple[Floats, Floats]:
        turn, low, high, inward, _ = _PAPILLARY[k]
        rows = self._rows[frame]
        n, column = len(rows), int(turn * rows.shape[1])
        root, over = rows[int(low * n), column], rows[int(high * n), column]
        return root, inward * over + (1.0 - inward) * rows[int(high * n)].mean(axis=0)


def _axis_of(rows: Floats) -> tuple[Floats, Floats, Floats]:
    """Middles of the first and the last row, and the direction from one to the other."""
    apex, base = rows[0].mean(axis=0), rows[-1].mean(axis=0)
    return apex, base, (base - apex) / np.linalg.norm(base - apex)


def _foot(p: Floats, start: Floats, end: Floats) -> Floats:
    """Closest point of a segment to each of p (n, 3)."""
    d = end - start
    t = np.clip((p - start) @ d / (d @ d), 0.0, 1.0)
    foot: Floats = start + t[:, None] * d
    return foot
