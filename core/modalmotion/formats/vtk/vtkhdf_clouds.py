"""Points of VTKHDF PolyData over time, other ones in each step; their cells are passed over."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.formats.parser.answer import Parsed
from modalmotion.formats.vtk.vtkhdf import (
    OURS,
    integers_of,
    malformed,
    points_of,
    require_poly_data,
    steps_of,
    text_of,
)
from modalmotion.limits import ReadLimits


def parse_vtkhdf_clouds(file: Any, limits: ReadLimits) -> Parsed:
    """Parse the points of an open file that has passed the gate.

    Parameters
    ----------
    file : h5py.File
    limits : ReadLimits

    Returns
    -------
    info : dict
        The unit, if a file of ours states it.
    arrays : dict of ndarray
        "points" (n, 3) of all steps, "offsets" (frames + 1), the first row of each and the end,
        maybe "times" (frames).

    Raises
    ------
    MalformedFileError
        If it is not PolyData of one part, or its offsets lead nowhere.
    """
    root = file["VTKHDF"]
    require_poly_data(root)
    n_points = integers_of(root, "NumberOfPoints")
    steps = steps_of(root, len(n_points))
    limits.require("frames", len(steps.parts))
    sizes = n_points[steps.parts]
    limits.require("vertices", int(sizes.max(initial=0)))
    points, starts = points_of(root), steps.points
    if sizes.min() < 0 or starts.min() < 0 or int((starts + sizes).max()) > len(points):
        raise malformed(
            f"The VTKHDF file contains {len(points)} points, fewer than its steps name."
        )
    # Steps may all name the same points.
    limits.require("decompressed_bytes", 24 * int(sizes.sum()))
    values = np.asarray(points[()], dtype=np.float64)
    rows = [values[a : a + n] for a, n in zip(starts.tolist(), sizes.tolist(), strict=True)]
    arrays: dict[str, NDArray[Any]] = {
        "points": np.concatenate(rows),
        "offsets": np.concatenate([[0], np.cumsum(sizes)]),
    }
    ours = file[OURS].attrs if OURS in file else {}
    if steps.times is not None and "times_unknown" not in ours:
        arrays["times"] = steps.times
    return {"unit": text_of(ours["unit"]) if "unit" in ours else None}, arrays
