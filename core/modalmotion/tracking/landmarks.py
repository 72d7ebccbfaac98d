"""Landmarks of a recording: one place, or one for each frame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError
from modalmotion.facts import Facts
from modalmotion.facts.json_form import read_object

Landmarks = Mapping[str, NDArray[np.float64]]
"""By name a place (3,), or (frames, 3) with NaN where it is unknown; in the points' unit."""


@dataclass(frozen=True, eq=False)
class Proposed:
    """A landmark that was proposed, and how far it may be off.

    Parameters
    ----------
    places : (frames, 3) float64, length unit
        NaN where it is unknown.
    sd : float, length unit
    normals : (frames, 3) float64, optional
        Directions along which it is known better.
    normal_sd : float, length unit
        Deviation along them, apart in each frame.
    covariance : (frames, frames) float64, length unit squared, optional
        Of errors along them that frames have in common, so that nothing averages them.
    """

    places: NDArray[np.float64]
    sd: float
    normals: NDArray[np.float64] | None = None
    normal_sd: float = 0.0
    covariance: NDArray[np.float64] | None = None


_REMEDY: Final = (
    'Write {"apex": [x, y, z], "base": [[x, y, z], null, ...]}: a place in the reference frame, or '
    "one for each frame."
)


def landmarks_from_json(text: str) -> dict[str, NDArray[np.float64]]:
    """Read landmarks by name: a place, or one for each frame and null where it is unknown.

    Raises
    ------
    ParameterError
        If it is no such object; it names the landmark.
    """
    values = read_object("landmarks", text)
    return {name: places_of(name, value) for name, value in values.items()}


def places_of(name: str, value: Any) -> NDArray[np.float64]:
    """Check the places of one landmark: [x, y, z], or a list of these and of nulls.

    Raises
    ------
    ParameterError
        If they are not finite numbers; it names the landmark and the frame.
    """
    if not isinstance(value, list) or not value:
        raise _no_place(name, None)
    if not any(isinstance(part, list) or part is None for part in value):
        return _place(name, None, value)
    rows = [_NOWHERE if part is None else _place(name, k, part) for k, part in enumerate(value)]
    return np.stack(rows)


def landmarks_of(facts: Facts) -> dict[str, NDArray[np.float64]]:
    """Take the landmarks that facts state, which must be points.

    Raises
    ------
    ParameterError
        If one is the number of a vertex: what is tracked has none.
    """
    for name, place in facts.landmarks.items():
        if not (isinstance(place, tuple) and all(isinstance(part, float) for part in place)):
            raise ParameterError(
                f"The landmark '{name}' is not a point; what is tracked has no vertices yet.",
                remedy="State it as x,y,z in the unit of the points.",
                details={"landmark": name},
            )
    return {name: np.array(place) for name, place in facts.landmarks.items()}


_NOWHERE: Final = np.full(3, np.nan)


def _place(name: str, frame: int | None, value: Any) -> NDArray[np.float64]:
    is_plain = isinstance(value, list) and all(type(part) in (int, float) for part in value)
    if not is_plain or len(value) != 3:
        raise _no_place(name, frame)
    try:
        x, y, z = map(float, value)
    except OverflowError:
        raise _no_place(name, frame) from None
    if not all(map(math.isfinite, (x, y, z))):
        raise _no_place(name, frame)
    return np.array([x, y, z])


def _no_place(name: str, frame: int | None) -> ParameterError:
    where = "" if frame is None else f" in frame {frame}"
    return ParameterError(
        f"The landmark '{name[:64]}' is not three finite numbers{where}.",
        remedy=_REMEDY,
        frame=frame,
        details={"landmark": name[:64]},
    )
