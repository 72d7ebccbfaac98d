"""How far volumes may be off by noise of the vertices, where nothing else is known of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.clinical.smooth_wall import smooth_walls
from modalmotion.errors import InputError
from modalmotion.mesh import Cavity
from modalmotion.mesh.cavity_gradient import volume_gradient
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.template import Template


def volume_deviations(
    sequence: MeshSequence, template: Template, cavity: Cavity
) -> NDArray[np.float64] | None:
    """Give the standard deviation of the volume in each frame.

    Parameters
    ----------
    sequence : MeshSequence
        A track states its own; of others noise is what a smooth wall leaves.
    template : Template
    cavity : Cavity

    Returns
    -------
    (frames,) float64, length unit cubed, or None
        None of a surface without coordinates, or of too few vertices.
    """
    if sequence.uncertainty is not None:
        return sequence.uncertainty.volumes
    positions = sequence.vertices.astype(np.float64)
    positions -= positions[0].mean(axis=0)
    try:
        is_lattice = sequence.grid is not None
        wall, _ = smooth_walls(template, positions, is_lattice=is_lattice, is_noisy=False)
    except InputError:
        return None
    variances = wall.noise(positions, wall.coefficients(positions))
    gradients = (volume_gradient(cavity, x) for x in positions)
    squares = np.array([float((gradient**2).sum()) for gradient in gradients])
    return np.asarray(np.sqrt(variances * squares), dtype=np.float64)
