"""Observations: what was seen of a surface in one frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np

from modalmotion import mesh, notes
from modalmotion.arguments.checking import FrozenArrays
from modalmotion.errors import NonFiniteError, ParameterError, ShapeError
from modalmotion.formats.frame import in_frame
from modalmotion.representation import Floats, Ints, shown

Place: TypeAlias = str | int | tuple[int, ...]
"""Where a landmark sits on the surface: "apex", "base", a vertex, or the mean of some."""

NAMED_PLACES: Final[tuple[str, ...]] = ("apex", "base")

# Points of one frame that are read: enough to know some hundred modes to a tenth of the noise.
_MOST_POINTS: Final = 20_000

# Fourth powers of coordinates are taken.
_LARGEST: Final = 1e60

# Consecutive multiples of it fall apart evenly.
_GOLDEN: Final = 0.6180339887498949


# Arrays beside the points, and what they have to be.
_FINITE: Final = {
    "sd": "positive lengths",
    "weights": "numbers from 0 on",
    "normals": "nonzero vectors",
}


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
        Of profiles, which have `normals` and `shares` too: vertices that each one starts between,
        so that its distance counts from there and not from the closest place of the surface.
    shares : (n, 3) float64, optional
        Of each of these vertices in the start; they add up to 1.
    end : {"apex", "base"}, optional
        Of the surface, that all points are at: those of a valve are at the base.
    border : (sides, 2, 3) float64, length unit, optional
        Of a mesh whose vertices the points are: both ends of each side without a neighbour.
    """

    points: Floats
    sd: Floats | float | None = None
    weights: Floats | None = None
    normals: Floats | None = None
    places: tuple[Place, ...] | None = None
    feet: Ints | None = None
    shares: Floats | None = None
    end: str | None = None
    border: Floats | None = None

    def __post_init__(self) -> None:
        points = _rows(self.points)
        n, arrays = len(points), {"points": points}
        for name, what in _FINITE.items():
            value = getattr(self, name)
            if value is None:
                continue
            shape = (n, 3) if name == "normals" else (n,)
            try:
                one = np.broadcast_to(value, shape) if name == "sd" else value
                array = np.array(one, dtype=np.float64)
            except (TypeError, ValueError):
                array = np.zeros(0)
            size = np.linalg.norm(np.atleast_2d(array), axis=-1) if name == "normals" else array
            is_right = np.isfinite(size) & ((size > 0) | ((name == "weights") & (size == 0)))
            if array.shape != shape or not is_right.all():
                raise ParameterError(
                    f"The {name} of {n} points are not {n} finite {what}.",
                    remedy="Give one for each point, or none.",
                )
            arrays[name] = array / size[:, None] if name == "normals" else array
        if self.places is not None and len(self.places) != n:
            raise ShapeError(
                f"{len(self.places)} places were named for {n} landmarks.",
                remedy="Name one place of the surface for each point.",
            )
        if self.end is not None and (self.end not in NAMED_PLACES or self.places is not None):
            raise ParameterError(
                f"The end of the points is {self.end!r:.40}, their places {self.places!r:.40}.",
                remedy="Name the end apex or base, or give places.",
            )
        if self.border is not None:
            arrays["border"] = _rows(np.reshape(self.border, (-1, 3))).reshape(-1, 2, 3)
        for name, array in arrays.items():
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.points)

    @property
    def is_landmark(self) -> bool:
        """Whether each row belongs to one place of the surface, or to an end of it."""
        return self.places is not None or self.end is not None


Frame: TypeAlias = tuple[Observation, ...]
"""All observations of one frame; none where it is missing."""


def ends_in(frame: Frame) -> dict[str, Floats]:
    """Places of apex and base that a frame states; of points of an end their middle."""
    ends = {part.end: part.points.mean(axis=0) for part in frame if part.end and len(part)}
    for part in frame:
        for place, point in zip(part.places or (), part.points, strict=False):
            # The mean of several vertices is that of an opening.
            if isinstance(place, tuple) and len(place) > 2:
                ends.setdefault("base", point)
            elif isinstance(place, str):
                ends[place] = point
    return ends


def states_end(frame: Frame, end: str) -> bool:
    """Whether a frame says where an end of the surface is."""
    return any(end in (part.end, *(part.places or ())) for part in frame)


def marks_at(frame: Frame, end: str) -> list[tuple[Floats, float]]:
    """Points of an end of the surface, with their deviations; 0 if one is not stated."""
    return [
        (point, 0.0 if part.sd is None else float(np.asarray(part.sd)[row]))
        for part in frame
        for row, point in enumerate(part.points)
        if end in (part.end, (part.places or [None] * len(part))[row])
    ]


def observed_frames(observed: Sequence[Any]) -> tuple[tuple[Frame, ...], tuple[notes.Note, ...]]:
    """Read the frames of any kind of observed sequence.

    Parameters
    ----------
    observed : sequence
        For each frame an `Observation`, several of them, an array (n, 3) of points, a mesh
        (vertices, faces), or None if the frame is missing.

    Returns
    -------
    tuple of Frame
    tuple of Note
        Notes for the user.

    Raises
    ------
    InputError
        Naming the frame that cannot be read.
    """
    frames, n_thinned = [], 0
    for k, item in enumerate(observed):
        with in_frame(k):
            frame = _frame_of(item)
        frames.append(tuple(map(_thinned, frame)))
        n_thinned += sum(map(len, frames[k])) < sum(map(len, frame))
    if not any(len(part) for frame in frames for part in frame):
        raise ShapeError(
            "Nothing was observed in any frame.",
            remedy="Send points, contours or a surface for at least one frame.",
        )
    note = notes.Note.of("points_thinned", n_frames=n_thinned, most=_MOST_POINTS)
    return tuple(frames), (note,) if n_thinned else ()


def _frame_of(item: Any) -> Frame:
    if item is None:
        return ()
    if isinstance(item, Observation):
        return (item,)
    if isinstance(item, (tuple, list)) and item and isinstance(item[0], Observation):
        return tuple(item)
    if isinstance(item, tuple) and len(item) == 2:
        return (of_surface(*item),)
    return () if np.size(item) == 0 else (Observation(item),)


def of_surface(vertices: Any, faces: Any) -> Observation:
    """Observe a mesh of any connectivity: its vertices, each by its share of the area.

    Parameters
    ----------
    vertices : (vertices, 3) array_like, length unit
    faces : (faces, 3) array_like of int
        In any winding; vertices in no triangle are left out.
    """
    x = _rows(vertices)
    faces = _rows(faces, "faces of a mesh").astype(np.int64)
    if faces.min(initial=0) < 0 or faces.max(initial=-1) >= len(x):
        raise ShapeError(
            f"Faces of shape {faces.shape} are not triangles of the {len(x)} vertices (0 to "
            f"{len(x) - 1}).",
            remedy="Give vertices (n, 3) and triangles (m, 3) of these.",
        )
    areas = np.linalg.norm(mesh.face_normals(x, faces), axis=1)
    weights = np.bincount(faces.ravel(), np.repeat(areas, 3), minlength=len(x))
    used = weights > 0
    if not used.any():
        return Observation(x)
    sides, _ = open_sides(faces)
    if len(sides) > len(faces):
        # Triangles that have their corners for themselves, as in an STL file.
        _, first, same = np.unique(x, axis=0, return_index=True, return_inverse=True)
        sides, _ = open_sides(first[same.reshape(-1)][faces])
    border = x[sides] if len(sides) else None
    return Observation(x[used], weights=weights[used] / weights[used].mean(), border=border)


def open_sides(faces: Ints) -> tuple[Ints, Ints]:
    """Sides of one triangle only, (sides, 2), and its third corner, (sides,).

    Triangles with a corner twice do not count.
    """
    a, b, c = faces.T
    proper = faces[(a != b) & (b != c) & (c != a)]
    sides = np.sort(proper[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    found, first, counts = np.unique(sides, axis=0, return_index=True, return_counts=True)
    own, opposite = found[counts == 1], proper[first[counts == 1] // 3].sum(axis=1)
    return own, opposite - own.sum(axis=1)


def _rows(points: Any, what: str = "points of an observation") -> Floats:
    """Copy points as rows of three finite numbers."""
    remedy = "Give one row x, y, z for each point, three vertices for each face."
    try:
        # Complex numbers have no order, and would be cut.
        rows = np.array(points).astype(np.float64, casting="same_kind")
    except (TypeError, ValueError):
        message = f"The {what} are not rows of real numbers."
        raise ParameterError(message, remedy=remedy) from None
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ShapeError(f"The {what} have the shape {rows.shape}, not (n, 3).", remedy=remedy)
    wrong = np.flatnonzero(~np.isfinite(rows).all(axis=1))
    if wrong.size:
        raise NonFiniteError(
            f"Point {int(wrong[0])} is not finite ({len(wrong)} of {len(rows)} are not).",
            remedy="Omit such points: a frame may have any number of points.",
            vertex=int(wrong[0]),
        )
    largest = float(np.abs(rows).max(initial=0.0))
    if largest > _LARGEST:
        raise ParameterError(
            f"A coordinate is {largest:.3g}, more than {_LARGEST:g}: its powers overflow.",
            remedy="Use a larger unit of length.",
        )
    return rows


def spread_rows(n: int, most: int) -> Ints:
    """Choose at most so many of n rows, spread evenly, in their order."""
    return np.sort(np.argsort(np.arange(n) * _GOLDEN % 1.0, kind="stable")[:most])


def _thinned(part: Observation) -> Observation:
    n = len(part)
    if n <= _MOST_POINTS or part.is_landmark or part.feet is not None:
        return part
    rows = spread_rows(n, _MOST_POINTS)
    own = {name: getattr(part, name) for name in ("sd", "weights", "normals")}
    kept = {name: value if value is None else value[rows] for name, value in own.items()}
    return Observation(part.points[rows], **kept, border=part.border)
