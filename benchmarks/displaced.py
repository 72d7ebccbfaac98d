"""Displacements of whole sequences, for bases that the library does not have."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.alignment.reference import displacements_from
from modalmotion.mesh.sequence import MeshSequence


def displaced(sequence: MeshSequence, weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Displacements from frame 0, rotation removed, (frames, vertices, 3), length unit."""
    blocks = displacements_from(0, sequence, weights).blocks()
    u = np.concatenate([block.u * block.shape.scale for block in blocks])
    return u.transpose(0, 2, 1)
