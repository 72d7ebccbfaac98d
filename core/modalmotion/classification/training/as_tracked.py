"""A simulated surface as a track of clouds leaves it: few modes, their noise, a rim that slides."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.normal_lines import vertex_normals
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topology import CUP
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import reconstruct
from modalmotion.template import make_template

# Modes that a track has by default, and points of a frame's cloud.
N_MODES: Final = 37
N_POINTS: Final = 2000

# Standard deviations at the height of the motion, mm, of how far the rim lies off along the
# surface: all of it, and one side of it up and the other down.
RIM_LEVEL: Final = 0.6
RIM_TILT: Final = 2.2

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
    Points say little of motion along the surface, so that it ends elsewhere than it should; this
    moves its area centroid, and with it all offsets.
    """
    exact = sequence.vertices.astype(np.float64)
    noisy = exact + rng.normal(0.0, noise, exact.shape) * np.sqrt(exact.shape[1] / N_POINTS)
    noisy[0] = exact[0]
    seen = replace(sequence, vertices=noisy)
    found = reconstruct(modal_signature(seen, _PARAMETERS), seen)
    return replace(sequence, vertices=_slid(sequence, found, rng))


def _slid(
    sequence: MeshSequence, x: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Move vertices from apex to base along the surface, as far as the beat has moved them."""
    template = make_template(sequence, by_rows=False)
    s, theta = template.coordinates.T * np.array([[1.0], [2.0 * np.pi]])
    level, towards, across = rng.normal(0.0, (RIM_LEVEL, RIM_TILT, RIM_TILT))
    far = s * (level + towards * np.cos(theta) + across * np.sin(theta))
    moved = np.sqrt(((x - x[0]) ** 2).mean(axis=(1, 2)))
    shares = moved / moved.max()
    slid = x.copy()
    for k, share in enumerate(shares):
        axis = (s - s.mean()) @ x[k]
        n = vertex_normals(x[k], template.faces)
        along = axis - (n @ axis)[:, None] * n
        length = np.linalg.norm(along, axis=1, keepdims=True)
        slid[k] += share * far[:, None] * along / np.maximum(length, 1e-9 * np.linalg.norm(axis))
    return slid
