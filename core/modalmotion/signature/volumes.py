"""Volume that a moving surface encloses, from its vertices alone."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import TopologyError
from modalmotion.mesh.cavity import cavity_of
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topology import PLANE
from modalmotion.template import Template

# Corners of triangles in memory at a time.
_BLOCK: Final = 2**20


def enclosed_volumes(sequence: MeshSequence, template: Template) -> NDArray[np.float64] | None:
    """Volume in each frame, each opening closed by a fan to the mean of its vertices.

    Parameters
    ----------
    sequence : MeshSequence
    template : Template
        Of the sequence: its triangles are read.

    Returns
    -------
    (frames,) float64, length unit cubed, or None
        Positive where it is largest, for either winding. None where the surface encloses
        nothing, as a curve, a sheet and several pieces do, or where cubes of its size overflow.
    """
    if template.surface == PLANE or not len(template.faces):
        return None
    try:
        cavity = cavity_of(template.faces, template.n_vertices)
    except TopologyError:
        return None
    n = sequence.n_frames
    volumes = np.empty(n)
    step = max(1, _BLOCK // (3 * len(cavity.faces)))
    with np.errstate(over="ignore", invalid="ignore"):
        for first in range(0, n, step):
            part = sequence.vertices[first : first + step].astype(np.float64)
            volumes[first : first + step] = cavity.volume(part)
    if not np.isfinite(volumes).all():
        return None
    largest = float(volumes[np.abs(volumes).argmax()])
    return volumes * np.sign(largest) if largest else None
