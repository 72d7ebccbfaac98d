"""What a request for a track means: its landmarks and its times."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.tracking.landmarks import Proposed
from modalmotion.tracking.observation import NAMED_PLACES, Frame, Observation


def in_mm(unit: str | None) -> str:
    """Check that images, which are in mm, are not stated in another unit."""
    if unit not in (None, "mm"):
        raise ParameterError(
            f"The unit {unit!r:.20} is stated, but images are placed in mm.",
            remedy="Omit the unit, and give landmarks in mm.",
        )
    return "mm"


def phases_of(
    times: NDArray[np.float64] | None, n: int, period: float | None, *, is_closed: bool
) -> NDArray[np.float64]:
    """Find the place of each frame in the cycle, or in the recording, 0 to 1."""
    if times is None or n == 1:
        return np.arange(n) / max(1, n if is_closed else n - 1)
    span = float(times[-1] - times[0])
    whole_time = span
    if is_closed:
        whole_time = span * n / (n - 1) if period is None else float(period)
        if not whole_time > span:
            raise ParameterError(
                f"The times span {span:g} s, the whole period of {whole_time:g} s: the last "
                "frame repeats the first.",
                remedy="Omit the last frame, give a longer period, or track with time open.",
                frame=n - 1,
            )
    phases: NDArray[np.float64] = (times - times[0]) / whole_time
    return phases


def with_landmarks(
    frames: tuple[Frame, ...],
    landmarks: Mapping[str, Any] | None,
    reference: int,
    sd: float | None = None,
) -> tuple[Frame, ...]:
    """Add stated landmarks to the frames that they are known in.

    `sd` is the deviation of those that state none, length unit; None is that of the points.
    """
    if not landmarks:
        return frames
    full = list(frames)
    box = _box(frames)
    for name, value in landmarks.items():
        own_sd = value.sd if isinstance(value, Proposed) else sd
        own = value.places if isinstance(value, Proposed) else value
        places = np.asarray(own, dtype=np.float64)
        if name not in NAMED_PLACES:
            raise ParameterError(
                f"The landmark '{name}' has no meaning.",
                remedy="State apex and base; other places as Observation(points, places=...).",
                details={"landmark": name},
            )
        if places.shape == (3,):
            row = np.full((len(frames), 3), np.nan)
            row[reference] = places
            places = row
        if places.shape != (len(frames), 3):
            raise ShapeError(
                f"The landmark '{name}' has the shape {places.shape}; there are {len(frames)} "
                "frames.",
                remedy="Give one place, or one for each frame with NaN if it is unknown.",
                details={"landmark": name},
            )
        for k, place in enumerate(places):
            if np.isfinite(place).all():
                _require_near(name, k, place, box)
                full[k] = (*full[k], Observation(place[None], sd=own_sd, places=(name,)))
                if isinstance(value, Proposed) and value.normals is not None:
                    across, limit = value.normals[k, None], value.normal_sd
                    one = Observation(place[None], sd=limit, normals=across, places=(name,))
                    full[k] = (*full[k], one)
    return tuple(full)


def _box(frames: tuple[Frame, ...]) -> NDArray[np.float64] | None:
    """Corners of the box around all points, (2, 3); None without points."""
    parts = [part.points for frame in frames for part in frame if len(part)]
    if not parts:
        return None
    points = np.concatenate(parts)
    return np.stack([points.min(axis=0), points.max(axis=0)])


def _require_near(
    name: str, frame: int, place: NDArray[np.float64], box: NDArray[np.float64] | None
) -> None:
    """Refuse a landmark farther from the points than they spread: it is in other coordinates."""
    if box is None:
        return
    outside = float(np.linalg.norm(np.maximum(np.maximum(box[0] - place, place - box[1]), 0.0)))
    spread = float(np.linalg.norm(box[1] - box[0]))
    if outside > spread > 0:
        raise ParameterError(
            f"The landmark '{name}' in frame {frame} is {outside:.3g} from the points, which "
            f"spread over {spread:.3g}.",
            remedy="State it in the unit and the coordinate system of the points (LPS and RAS "
            "differ in the signs of x and y).",
            frame=frame,
            details={"landmark": name, "distance": outside, "spread": spread},
        )
