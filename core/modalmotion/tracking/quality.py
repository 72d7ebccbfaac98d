"""How well the points of a frame fit the surface, and how much of it they lie at."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from modalmotion.modes.topology import CLOSED
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.information import Information

# Cells of the natural coordinates in which a point covers the surface.
_CELLS: Final = {1: (24,), 2: (6, 12)}


class Quality(NamedTuple):
    """Figures of one frame.

    Parameters
    ----------
    rms, p95 : float, length unit
        Of the distances of the points that counted; NaN without any.
    inliers : float
        Share of the points that counted.
    coverage : float
        Share of the surface in cells that points lie at.
    """

    rms: float
    p95: float
    inliers: float
    coverage: float


def quality_of(surface: Deformable, info: Information) -> Quality:
    """Measure the fit of one frame."""
    counted = info.weights > 0
    if not counted.any():
        return Quality(np.nan, np.nan, 0.0, 0.0)
    size = np.linalg.norm(info.residuals[counted], axis=1)
    rms = float(np.sqrt((size**2).mean()))
    template = surface.template
    cells = _CELLS[template.topology.n_axes]
    cell = np.zeros(template.n_vertices, dtype=np.int64)
    for axis, n in enumerate(cells):
        s = template.coordinates[:, axis]
        s = s % 1.0 if template.topology.ends[axis] == CLOSED else s
        place = np.clip(s * n, 0, n - 1).astype(np.int64)
        cell = cell * n + place
    share = np.bincount(cell, template.weights, minlength=int(np.prod(cells)))
    touched = np.zeros(len(share), dtype=np.bool_)
    touched[cell[info.feet[counted]].ravel()] = True
    return Quality(
        rms,
        float(np.quantile(size, 0.95)),
        float(info.weights[counted].sum() / len(info.weights)),
        float(share[touched].sum()),
    )
