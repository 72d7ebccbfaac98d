"""Points out of place: a vertex apart from its neighbours, a frame numbered or scaled otherwise.

The edges decide, which hardly change when a surface moves; the fit says only where to look.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.fit.fit import Fit
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numerals import numeral
from modalmotion.template import Template

# A largest error is checked beyond so many p95 errors, or this share of the surface.
_P95S: Final = 8.0
_SHARE: Final = 0.2

# Edges of a stray vertex are longer by at least this share of the error; half of the edges of a
# frame that is numbered otherwise are longer, or shorter, by this factor.
_OF_ERROR: Final = 0.5
_FACTOR: Final = 3.0


def notes_on_strays(sequence: MeshSequence, template: Template, fit: Fit) -> list[str]:
    """Name the frame with the largest error, and its vertex, if they are out of place.

    Costs nothing where the errors are those of a surface that moves.

    Parameters
    ----------
    sequence : MeshSequence
    template : Template
        Its vertices are the reference.
    fit : Fit
        Of the sequence.

    Returns
    -------
    list of str
        Empty, or one note.
    """
    start, unit = template.vertices, sequence.unit or "length units"
    # Direction by direction, which is ten times as fast as all at once.
    extent = max(float(np.ptp(x)) for x in start.T)
    largest = fit.errors.surface_max
    frame, error = int(largest.argmax()), float(largest.max())
    farthest = int(fit.weighted_motion_rms.argmax())
    suspects = []
    if fit.weighted_motion_rms[farthest] > _SHARE * extent:
        suspects.append(farthest)
    if error > min(_P95S * float(fit.errors.p95[frame]), _SHARE * extent):
        suspects.append(frame)
    sides = _sides(template) if suspects else np.zeros((0, 2), dtype=np.int64)
    if not len(sides) or not extent > 0:
        return []
    before = _lengths(start, sides, extent)
    usual = float(np.median(before))
    for suspect in suspects:
        after = _lengths(sequence.vertices[suspect].astype(np.float64), sides, extent)
        length = float(np.median(after))
        if not usual / _FACTOR <= length <= usual * _FACTOR:
            text = (
                f"Frame {suspect} does not go with the others: half of its edges are "
                f"{length / usual if usual > 0 else np.inf:.3g} times as long as in the reference. "
                "Its vertices may be numbered otherwise, or be in another unit; send it again or "
                "leave it out."
            )
            return [text]
    growth = np.full(len(start), np.inf)
    np.minimum.at(growth, sides.ravel(), np.repeat(after - before, 2))
    growth[np.isinf(growth)] = 0.0
    strays = np.flatnonzero(growth > _OF_ERROR * error / extent)
    if frame not in suspects or not len(strays):
        return []
    vertex = int(growth.argmax())
    more = "" if len(strays) == 1 else f" ({len(strays)} such vertices in this frame)"
    text = (
        f"Frame {frame}, vertex {vertex} is out of place: each edge to its neighbours is at least "
        f"{numeral(float(growth[vertex]) * extent)} {unit} longer than in the reference{more}. "
        "Correct the vertex or its number, or leave the frame out: the errors stated here count it."
    )
    return [text]


def _sides(template: Template) -> NDArray[np.int64]:
    """Pairs of neighbours, those inside a surface twice."""
    if len(template.faces):
        sides: NDArray[np.int64] = template.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        proper: NDArray[np.int64] = sides[sides[:, 0] != sides[:, 1]]
        return proper
    if template.surface is not None and template.surface.n_axes == 1:
        along = np.arange(len(template.vertices))
        return np.stack([along[:-1], along[1:]], axis=1)
    return np.zeros((0, 2), dtype=np.int64)


def _lengths(
    vertices: NDArray[np.float64], sides: NDArray[np.int64], extent: float
) -> NDArray[np.float64]:
    """Lengths of sides over the extent, whose squares are ordinary numbers in any unit."""
    along = (vertices[sides[:, 1]] - vertices[sides[:, 0]]) / extent
    lengths: NDArray[np.float64] = np.linalg.norm(along, axis=1)
    return lengths
