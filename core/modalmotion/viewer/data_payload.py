"""The data that a surface was tracked through, as the viewer draws them over it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.tracking.result import SampledData
from modalmotion.viewer.container import write_container
from modalmotion.viewer.payload import single_scale


def data_payload(data: SampledData) -> bytes:
    """Write points of all frames, in the viewer's form.

    Parameters
    ----------
    data : SampledData

    Returns
    -------
    bytes
        `read_container` reads them. `points` (n, 3) are float32 from the header's `origin`, in its
        `length`: 1 in the unit of the sequence, but for extremes; `weights` (n,) from 0 of a
        stray to 255; `landmarks` (n,) 0 or 1; `counts` in the header has the points of each frame.
    """
    origin = data.points.mean(axis=0) if data.n_points else np.zeros(3)
    away = data.points - origin
    length = single_scale(float(np.abs(away).max(initial=0.0)))
    header = {"origin": origin.tolist(), "length": length, "counts": data.counts.tolist()}
    arrays: dict[str, NDArray[Any]] = {
        "points": (away / length).astype(np.float32),
        "weights": np.rint(255.0 * np.clip(data.weights, 0.0, 1.0)).astype(np.uint8),
        "landmarks": data.are_landmarks.astype(np.uint8),
    }
    return write_container(header, arrays)
