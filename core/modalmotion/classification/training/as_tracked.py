"""A simulated surface as a track of clouds leaves it: few modes, and their noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topology import CUP
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import reconstruct

# Modes that a track has by default, and points of a frame's cloud.
N_MODES: Final = 37
N_POINTS: Final = 2000

_PARAMETERS: Final = SignatureParameters(modes=N_MODES, reference=0, topology=CUP.name)


def as_tracked(sequence: MeshSequence, noise: float, rng: np.random.Generator) -> MeshSequence:
    """Reduce the motion of a cup to what a track through clouds keeps of it.

    Parameters
    ----------
    sequence : MeshSequence
        Of a cup, without noise.
    noise : float, mm
        Standard deviation of each coordinate of the clouds' points.
    rng : numpy.random.Generator

    Returns
    -------
    MeshSequence
        Frame 0 is as it was: a track starts from a surface that is given.

    Raises
    ------
    ModeCountError
        If the vertices do not tell as many modes apart.

    Notes
    -----
    Displacements from frame 0 are cut down to the modes of a track. The noise of an amplitude falls
    with the root of the number of points, so that of the vertices is scaled to that of the clouds.
    That the end of the surface slides is left out: see docs/decisions/0053-what-a-track-leaves.md.
    """
    exact = sequence.vertices.astype(np.float64)
    noisy = exact + rng.normal(0.0, noise, exact.shape) * np.sqrt(exact.shape[1] / N_POINTS)
    noisy[0] = exact[0]
    seen = replace(sequence, vertices=noisy)
    return replace(sequence, vertices=reconstruct(modal_signature(seen, _PARAMETERS), seen))
