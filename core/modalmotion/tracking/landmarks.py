"""Landmarks of a recording: one place, or one for each frame, in files and as JSON."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from modalmotion.errors import MalformedFileError, ParameterError, ShapeError
from modalmotion.mesh import UNKNOWN, Facts, fact_forms
from modalmotion.mesh.facts import WORDS
from modalmotion.notes import Note
from modalmotion.representation import Floats, counted, shown
from modalmotion.tracking.observation import NAMED_PLACES, Frame, Observation

Landmarks = Mapping[str, Floats]
"""By name a place (3,), or (frames, 3) with NaN if it is unknown; in the points' unit."""


@dataclass(frozen=True, eq=False)
class Proposed:
    """A landmark that was proposed, and how far it may be off.

    Parameters
    ----------
    places : (frames, 3) float64, length unit
        NaN if it is unknown.
    sd : float, length unit
    normals : (frames, 3) float64, optional
        Directions along which it is known better.
    normal_sd : float, length unit
        Deviation along them, apart in each frame.
    covariance : (frames, frames) float64, length unit squared, optional
        Of errors along them that frames have in common, so that nothing averages them.
    """

    places: Floats
    sd: float
    normals: Floats | None = None
    normal_sd: float = 0.0
    covariance: Floats | None = None


_REMEDY: Final = (
    'Write {"apex": [x, y, z], "base": [[x, y, z], null, ...]}: a place in the reference frame, or '
    "one for each frame."
)


def landmarks_from_json(text: str) -> dict[str, Floats]:
    """Read landmarks by name: a place, or one for each frame and null where it is unknown.

    Raises
    ------
    ParameterError
        If it is no such object; it names the landmark.
    """
    values = fact_forms.read_object("landmarks", text)
    return {name: places_of(name, value) for name, value in values.items()}


def places_of(name: str, value: Any) -> Floats:
    """Check the places of one landmark.

    Parameters
    ----------
    name : str
    value : array_like
        One place (3,), or one for each frame, (frames, 3), with None or NaN where it is unknown.

    Raises
    ------
    ParameterError
        If they are not finite numbers; it names the landmark and the frame.
    """
    value = value.tolist() if isinstance(value, np.ndarray) else value
    each = value if isinstance(value, list | tuple) else ()
    if any(one is None or isinstance(one, list | tuple | np.ndarray) for one in each):
        return np.stack([_place(name, k, one) for k, one in enumerate(each)])
    return _place(name, None, each)


def _place(name: str, frame: int | None, value: Any) -> Floats:
    numbers = [np.nan] * 3 if value is None else value
    try:
        place = np.array(numbers).astype(np.float64, casting="same_kind")
    except (TypeError, ValueError):
        place = np.zeros(0)
    is_unknown = frame is not None and np.isnan(place).all()
    is_known = place.shape == (3,) and not any(isinstance(x, bool) for x in numbers)
    if is_known and (is_unknown or np.isfinite(place).all()):
        return place
    where = "" if frame is None else f" in frame {frame}"
    raise ParameterError(
        f"The landmark '{name[:64]}' is not three finite numbers{where}.",
        remedy=_REMEDY,
        frame=frame,
        details={"landmark": name[:64]},
    )


def landmarks_of(facts: Facts) -> dict[str, Floats]:
    """Take the landmarks that facts state, which must be points.

    Raises
    ------
    ParameterError
        If one is the number of a vertex: what is tracked has none.
    """
    for name, place in facts.landmarks.items():
        if not (isinstance(place, tuple) and all(isinstance(part, float) for part in place)):
            raise ParameterError(
                f"The landmark '{name}' is not a point; a recording to be tracked has no fixed "
                "vertices.",
                remedy="Give it as x,y,z in the unit of the points.",
                details={"landmark": name},
            )
    return {name: np.array(place) for name, place in facts.landmarks.items()}


LANDMARK_SUFFIXES: Final = (".mrk.json", "landmarks.json")
"""Ends of the names of files of landmarks among frames."""

LPS: Final = "LPS"
"""System of points that state none: that of DICOM, in which Slicer saves models."""

_LONGEST: Final = 1_000_000
_FILE_REMEDY: Final = (
    'Save it as .mrk.json from Slicer, or write {"coordinates": "LPS", "landmarks": {"apex": '
    "[x, y, z], ...}}."
)

# As Slicer numbers points of one name: base-1, base_2, base 3. Their middle counts.
_LABEL: Final = re.compile(rf"({'|'.join(NAMED_PLACES)})(?:[ _-]?[0-9]+)?", re.IGNORECASE)

# x and y of the one are those of the other, turned round.
_TURNED: Final = np.array([-1.0, -1.0, 1.0])


@shown("coordinates", "unit", "places")
@dataclass(frozen=True, eq=False)
class LandmarkFile:
    """Landmarks as a file states them.

    Parameters
    ----------
    places : dict of str to (3,) or (frames, 3) float64
        In the file's own coordinate system and unit; NaN if one is unknown.
    coordinates : {"LPS", "RAS"} or None
        The system, where the file states it.
    unit : str or None
    notes : tuple of Note
    """

    places: dict[str, Floats]
    coordinates: str | None
    unit: str | None
    notes: tuple[Note, ...] = ()

    def for_points(self, coordinates: str | None, unit: str | None) -> dict[str, Floats]:
        """Give the places in the coordinate system of points: turned round once, or as they are.

        Parameters
        ----------
        coordinates : str or None
            Of the points; LPS where it is unknown.
        unit : str or None
            Of the points.

        Raises
        ------
        ParameterError
            If the units are known and differ.
        """
        if None not in (unit, self.unit) and unit != self.unit:
            raise ParameterError(
                f"The landmarks are in {self.unit}, the points in {unit}.",
                remedy="Give both in the same unit.",
            )
        if self.coordinates in (None, LPS if coordinates in (None, UNKNOWN) else coordinates):
            return self.places
        return {name: places * _TURNED for name, places in self.places.items()}


def read_landmark_file(data: bytes) -> LandmarkFile:
    """Read a file of landmarks.

    Parameters
    ----------
    data : bytes
        Slicer's markups, whose control points are called apex and base (of base-1, base-2, ...
        the middle counts); or ours, an object with `landmarks` by name as
        `modalmotion.tracking.landmarks` has them, and maybe `coordinates` and `unit`.

    Raises
    ------
    MalformedFileError
        If it is neither.
    ParameterError
        If a place is not three finite numbers.
    """
    if len(data) > _LONGEST:
        raise _malformed(f"it has {len(data)} bytes, more than {_LONGEST}")
    try:
        content = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise _malformed(str(error)[:100]) from error
    if not isinstance(content, dict):
        raise _malformed(f"it is a {type(content).__name__}")
    if "markups" in content:
        return _of_slicer(content["markups"])
    if not isinstance(content.get("landmarks"), dict):
        raise _malformed("it has neither 'landmarks' nor 'markups'")
    places = {name: places_of(name, value) for name, value in content["landmarks"].items()}
    return LandmarkFile(places, _system(content.get("coordinates")), _unit(content.get("unit")))


def _of_slicer(markups: Any) -> LandmarkFile:
    points: dict[str, list[Floats]] = {}
    others: list[str] = []
    try:
        systems = {_system(markup.get("coordinateSystem")) for markup in markups}
        units = {_unit(markup.get("coordinateUnits")) for markup in markups}
        for point in [point for markup in markups for point in markup["controlPoints"]]:
            label = str(point.get("label", "")).strip()
            match = _LABEL.fullmatch(label)
            if point.get("positionStatus", "defined") != "defined":
                continue
            if match is None:
                others.append(repr(label[:40]))
                continue
            name = match[1].lower()
            points.setdefault(name, []).append(places_of(name, point["position"]))
    except (KeyError, TypeError, AttributeError) as error:
        raise _malformed("its markups have no control points with positions") from error
    if len(systems) > 1 or len(units) > 1:
        raise _malformed("its markups are in several coordinate systems or units")
    if not points:
        found = ": " + ", ".join(others[:5]) if others else "; there are none"
        raise MalformedFileError(
            f"None of the control points is called apex or base{found}.",
            remedy="Rename them in Slicer: apex, and base (or base-1, base-2, ... round the "
            "opening).",
        )
    note = Note.of(
        "points_not_used", points=counted(len(others), "control point"), names=", ".join(others[:3])
    )
    middles = {name: np.mean(rows, axis=0) for name, rows in points.items()}
    return LandmarkFile(middles, systems.pop(), units.pop(), (note,) if others else ())


def _system(stated: Any) -> str | None:
    if stated is None or stated == "unknown":
        return None
    word = str(stated).upper()
    if word not in WORDS["coordinates"]:
        raise ParameterError(
            f"The landmarks are in the coordinate system {str(stated)[:40]!r}.",
            remedy="Use LPS or RAS, or omit it.",
        )
    return word


def _unit(stated: Any) -> str | None:
    return str(stated)[:20] if stated else None


def _malformed(reason: str) -> MalformedFileError:
    return MalformedFileError(f"It is not a landmark file ({reason}).", remedy=_FILE_REMEDY)


def with_landmarks(
    frames: tuple[Frame, ...],
    landmarks: Mapping[str, Any] | None,
    reference: int,
    sd: float | None = None,
) -> tuple[Frame, ...]:
    """Add stated landmarks to the frames that they are known in.

    `sd` is the deviation of those that state none, length unit; None is that of the points.
    """
    full = list(frames)
    points = np.concatenate([np.zeros((0, 3)), *(p.points for frame in frames for p in frame)])
    points = np.stack([points.min(axis=0), points.max(axis=0)]) if len(points) else points
    for name, value in (landmarks or {}).items():
        proposed = value if isinstance(value, Proposed) else None
        own_sd = sd if proposed is None else proposed.sd
        places = places_of(name, value if proposed is None else proposed.places)
        if name not in NAMED_PLACES:
            raise ParameterError(
                f"The landmark '{name}' has no meaning.",
                remedy="Give apex and base; other places as Observation(points, places=...).",
                details={"landmark": name},
            )
        if places.shape == (3,):
            is_there = np.arange(len(frames)) == reference
            places = np.where(is_there[:, None], places, np.nan)
        if places.shape != (len(frames), 3):
            raise ShapeError(
                f"The landmark '{name}' has the shape {places.shape}; there are {len(frames)} "
                "frames.",
                remedy="Give one place, or one for each frame with NaN if it is unknown.",
                details={"landmark": name},
            )
        for k in np.flatnonzero(np.isfinite(places).all(axis=1)).tolist():
            _require_near(name, k, places[k], points)
            full[k] = (*full[k], Observation(places[k, None], sd=own_sd, places=(name,)))
            if proposed is not None and proposed.normals is not None:
                across, limit = proposed.normals[k, None], proposed.normal_sd
                one = Observation(places[k, None], sd=limit, normals=across, places=(name,))
                full[k] = (*full[k], one)
    return tuple(full)


def _require_near(name: str, frame: int, place: Floats, points: Floats) -> None:
    """Refuse a landmark farther from the points than they spread: it is in other coordinates."""
    if not len(points):
        return
    low, high = points.min(axis=0), points.max(axis=0)
    outside = float(np.linalg.norm(np.maximum(np.maximum(low - place, place - high), 0.0)))
    spread = float(np.linalg.norm(high - low))
    if outside > spread > 0:
        raise ParameterError(
            f"The landmark '{name}' in frame {frame} is {outside:.3g} from the points, whose "
            f"extent is {spread:.3g}.",
            remedy="Give it in the unit and the coordinate system of the points (LPS and RAS "
            "differ in the signs of x and y).",
            frame=frame,
            details={"landmark": name, "distance": outside, "spread": spread},
        )
