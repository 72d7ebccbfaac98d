"""Errors of volumes by noise of the vertices, if nothing else is known of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.clinical.smooth_wall import smooth_walls
from modalmotion.errors import InputError
from modalmotion.mesh import Cavity
from modalmotion.mesh.geometry import volume_gradient
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numeric.scales import power_of_two
from modalmotion.template import Template


def volume_deviations(
    sequence: MeshSequence, template: Template, cavity: Cavity
) -> NDArray[np.float64] | None:
    """Return the standard deviation of the volume in each frame.

    Parameters
    ----------
    sequence : MeshSequence
        A track has its own errors; otherwise noise is the residual from smooth functions.
    template : Template
    cavity : Cavity

    Returns
    -------
    (frames,) float64, length unit cubed, or None
        None for a surface without coordinates, too few vertices, or one frame.
    """
    if sequence.uncertainty is not None:
        return sequence.uncertainty.volumes
    if sequence.n_frames < 2:
        return None
    positions = sequence.vertices.astype(np.float64)
    positions -= positions[0].mean(axis=0)
    unit = power_of_two(float(np.abs(positions).max()) or 1.0)
    positions /= unit
    try:
        is_lattice = sequence.grid is not None
        wall, _ = smooth_walls(template, is_lattice=is_lattice)
    except InputError:
        return None
    # Roughness that is constant is shape, not noise.
    moves = positions - positions.mean(axis=0)
    variances = wall.noise(moves, wall.coefficients(moves))
    variances *= sequence.n_frames / (sequence.n_frames - 1)
    gradients = (volume_gradient(cavity, x) for x in positions)
    squares = np.array([float((gradient**2).sum()) for gradient in gradients])
    return np.asarray(unit**3 * np.sqrt(variances * squares), dtype=np.float64)
