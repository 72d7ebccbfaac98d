"""Observations: what was seen of a surface in one frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import NonFiniteError, ParameterError, ShapeError
from modalmotion.mesh import face_normals
from modalmotion.representation import FrozenArrays, shown

Place: TypeAlias = str | int | tuple[int, ...]
"""Where a landmark sits on the surface: "apex", "base", a vertex, or the mean of some."""

NAMED_PLACES: Final[tuple[str, ...]] = ("apex", "base")

# Points of one frame that are read: enough to know some hundred modes to a tenth of the noise.
_MOST_POINTS: Final = 20_000

# Fourth powers of coordinates are taken.
_LARGEST: Final = 1e60

# Consecutive multiples of it fall apart evenly.
_GOLDEN: Final = 0.6180339887498949


@shown()
@dataclass(frozen=True, eq=False)
class Observation(FrozenArrays):
    """Rows of one frame: each a place in space, and where the surface passes it.

    Points say that the surface passes through them somewhere, and a distance along it means
    nothing. Points of a profile, with `normals`, say how far it is along a fixed direction only.
    Landmarks, with `places`, say where one place of the surface is, along it too. Points of an end,
    with `end`, say that the rim of an opening passes through them somewhere.

    Parameters
    ----------
    points : (n, 3) float64, length unit
    sd : float or (n,) float64, length unit, optional
        Standard deviation of each; estimated from all of them where it is None.
    weights : (n,) float64, optional
        Of each row; 1 for all where it is None. Only their ratios matter to points.
    normals : (n, 3) float64, optional
        Direction in which the distance counts; where it is None that of the surface, and of
        landmarks every direction.
    places : tuple of str, int or tuple of int, optional
        Of each row of a landmark: see `Place`.
    feet : (n, 3) int64, optional
        Of profiles: vertices that each one starts between, so that its distance counts from there
        and not from the closest place of the surface.
    shares : (n, 3) float64, optional
        Of each of these vertices in the start; they add up to 1.
    end : {"apex", "base"}, optional
        Of the surface, that all points are at: those of a valve are at the base.
    border : (sides, 2, 3) float64, length unit, optional
        Of a mesh whose vertices the points are: both ends of each side without a neighbour.
    """

    points: NDArray[np.float64]
    sd: NDArray[np.float64] | float | None = None
    weights: NDArray[np.float64] | None = None
    normals: NDArray[np.float64] | None = None
    places: tuple[Place, ...] | None = None
    feet: NDArray[np.int64] | None = None
    shares: NDArray[np.float64] | None = None
    end: str | None = None
    border: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        points = _numbers(self.points)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ShapeError(
                f"The points of an observation have the shape {points.shape}, not (n, 3).",
                remedy="Give one row x, y, z for each point.",
            )
        _require_finite(points)
        object.__setattr__(self, "points", points)
        n = len(points)
        if self.sd is not None:
            sd = np.array(np.broadcast_to(np.asarray(self.sd, dtype=np.float64), (n,)))
            if not (np.isfinite(sd) & (sd > 0)).all():
                raise ParameterError(
                    "A standard deviation of an observation is not a finite length above zero.",
                    remedy="Give lengths above zero, or leave them out to have them estimated.",
                )
            object.__setattr__(self, "sd", sd)
        if self.weights is not None:
            weights = np.array(self.weights, dtype=np.float64)
            if weights.shape != (n,) or not (np.isfinite(weights) & (weights >= 0)).all():
                raise ParameterError(
                    f"The weights of {n} points are not {n} finite numbers from 0 on.",
                    remedy="Give one weight for each point, or none.",
                )
            object.__setattr__(self, "weights", weights)
        if self.normals is not None:
            normals = np.array(self.normals, dtype=np.float64)
            size = np.linalg.norm(normals, axis=-1) if normals.shape == (n, 3) else np.zeros(1)
            if not (np.isfinite(size) & (size > 0)).all():
                raise ParameterError(
                    f"The directions of {n} points are not {n} finite vectors other than zero.",
                    remedy="Give one direction for each point, or none.",
                )
            object.__setattr__(self, "normals", normals / size[:, None])
        if self.places is not None and len(self.places) != n:
            raise ShapeError(
                f"{len(self.places)} places were named for {n} landmarks.",
                remedy="Name one place of the surface for each point.",
            )
        if self.end is not None and (self.end not in NAMED_PLACES or self.places is not None):
            raise ParameterError(
                f"Points are at the end {self.end!r:.40} of a surface"
                f"{'' if self.places is None else ', and at places of their own'}.",
                remedy="Name the end apex or base, or give places.",
            )
        if self.feet is not None or self.shares is not None:
            starts = (self.feet, self.shares, self.normals)
            own = tuple(None if part is None else part.shape for part in starts)
            if own != ((n, 3), (n, 3), (n, 3)):
                raise ShapeError(
                    "Profiles need the three vertices that each starts between, their shares and "
                    f"directions, (n, 3) each; their shapes are {own}.",
                    remedy="Give feet, shares and normals together, or only points.",
                )
        if self.border is not None:
            border = _numbers(self.border)
            if border.ndim != 3 or border.shape[1:] != (2, 3):
                raise ShapeError(
                    f"The border of a mesh has the shape {border.shape}, not (sides, 2, 3).",
                    remedy="Give both ends of each side that has one triangle only, or none.",
                )
            _require_finite(border.reshape(-1, 3))
            object.__setattr__(self, "border", border)
        arrays = (self.points, self.sd, self.weights, self.normals, self.feet, self.shares)
        for array in (*arrays, self.border):
            if isinstance(array, np.ndarray):
                array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.points)

    @property
    def is_landmark(self) -> bool:
        """Whether each row belongs to one place of the surface, or to an end of it."""
        return self.places is not None or self.end is not None


Frame: TypeAlias = tuple[Observation, ...]
"""All observations of one frame; none where it is missing."""


def observed_frames(observed: Sequence[Any]) -> tuple[tuple[Frame, ...], tuple[str, ...]]:
    """Read the frames of any kind of observed sequence.

    Parameters
    ----------
    observed : sequence
        For each frame an `Observation`, several of them, an array (n, 3) of points, a mesh
        (vertices, faces), or None if the frame is missing.

    Returns
    -------
    tuple of Frame
    tuple of str
        Notes for the user.

    Raises
    ------
    InputError
        Naming the frame that cannot be read.
    """
    frames, n_thinned = [], 0
    for k, item in enumerate(observed):
        try:
            frame = _frame_of(item)
        except (ShapeError, NonFiniteError, ParameterError) as error:
            error.frame = k
            error.message = f"Frame {k}: {error.message}"
            raise
        thinned = tuple(_thinned(part) for part in frame)
        n_thinned += any(a is not b for a, b in zip(frame, thinned, strict=True))
        frames.append(thinned)
    if not frames or not any(len(part) for frame in frames for part in frame):
        raise ShapeError(
            "Nothing was observed in any frame.",
            remedy="Send points, contours or a surface for at least one frame.",
        )
    notes: tuple[str, ...] = ()
    if n_thinned:
        note = (
            f"{n_thinned} frames have more than {_MOST_POINTS:,} points; as many of each were read."
        )
        notes = (note,)
    return tuple(frames), notes


def _frame_of(item: Any) -> Frame:
    if item is None:
        return ()
    if isinstance(item, Observation):
        return (item,)
    if isinstance(item, (tuple, list)) and item and isinstance(item[0], Observation):
        return tuple(item)
    if isinstance(item, tuple) and len(item) == 2:
        return (of_surface(*item),)
    points = _numbers(item)
    return () if points.size == 0 else (Observation(points),)


def of_surface(vertices: Any, faces: Any) -> Observation:
    """Observe a mesh of any connectivity: its vertices, each by its share of the area.

    Parameters
    ----------
    vertices : (vertices, 3) array_like, length unit
    faces : (faces, 3) array_like of int
        In any winding; vertices in no triangle are left out.
    """
    try:
        x, faces = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    except (TypeError, ValueError):
        x = faces = np.zeros(0)
    if x.ndim != 2 or x.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise ShapeError(
            f"Vertices of shape {x.shape} and faces of shape {faces.shape} are not a mesh.",
            remedy="Give vertices (n, 3) and triangles (m, 3).",
        )
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(x):
        raise ShapeError(
            f"A triangle names a vertex that does not exist; there are {len(x)} (0 to "
            f"{len(x) - 1}).",
            remedy="Send the triangles of these vertices.",
        )
    _require_finite(x)
    areas = np.linalg.norm(face_normals(x, faces), axis=1)
    weights = np.bincount(faces.ravel(), np.repeat(areas, 3), minlength=len(x))
    used = weights > 0
    if not used.any():
        return Observation(x)
    border = _border_of(x, faces)
    return Observation(x[used], weights=weights[used] / weights[used].mean(), border=border)


def _border_of(x: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64] | None:
    """Sides of one triangle only, (sides, 2, 3); None of a mesh without any."""
    sides = _open_sides(faces)
    if len(sides) > len(faces):
        # Triangles that have their corners for themselves, as in an STL file.
        same = np.unique(x, axis=0, return_inverse=True)[1].reshape(-1)
        first = np.full(len(x), len(x))
        np.minimum.at(first, same, np.arange(len(x)))
        sides = _open_sides(first[same][faces])
    return x[sides] if len(sides) else None


def _open_sides(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    a, b, c = faces.T
    proper = faces[(a != b) & (b != c) & (c != a)]
    sides = np.sort(proper[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    n = np.int64(faces.max(initial=0)) + 1
    keys, counts = np.unique(sides[:, 0] * n + sides[:, 1], return_counts=True)
    keys = keys[counts == 1]
    open_sides: NDArray[np.int64] = np.stack([keys // n, keys % n], axis=1)
    return open_sides


def _numbers(points: Any) -> NDArray[np.float64]:
    """Copy points as real numbers."""
    cause: Exception | None = None
    try:
        rows = np.array(points)
        if not np.iscomplexobj(rows):
            numbers: NDArray[np.float64] = rows.astype(np.float64)
            return numbers
    except (TypeError, ValueError) as error:
        cause = error
    raise ParameterError(
        "The points are not rows of real numbers.",
        remedy="Give one row x, y, z for each point.",
    ) from cause


def _require_finite(points: NDArray[np.float64]) -> None:
    wrong = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if wrong.size:
        raise NonFiniteError(
            f"Point {int(wrong[0])} is not finite ({len(wrong)} of {len(points)} are not).",
            remedy="Leave such points out: a frame may have any number of them.",
            vertex=int(wrong[0]),
        )
    largest = float(np.abs(points).max(initial=0.0))
    if largest > _LARGEST:
        raise ParameterError(
            f"A coordinate is {largest:.3g}, more than {_LARGEST:g}: its powers are no numbers.",
            remedy="State lengths in a larger unit.",
        )


def _thinned(part: Observation) -> Observation:
    n = len(part)
    if n <= _MOST_POINTS or part.is_landmark or part.feet is not None:
        return part
    order = np.argsort(np.arange(n) * _GOLDEN % 1.0, kind="stable")[:_MOST_POINTS]
    rows = np.sort(order)
    return Observation(
        part.points[rows],
        sd=part.sd[rows] if isinstance(part.sd, np.ndarray) else part.sd,
        weights=None if part.weights is None else part.weights[rows],
        normals=None if part.normals is None else part.normals[rows],
        border=part.border,
    )
