"""Torsion and shear of a wall whose points follow the tissue.

A surface does not show how far its points slide along it; vertices that follow the tissue do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from modalmotion.clinical.smooth_wall import smooth_walls
from modalmotion.clinical.wall_motion import WallMotion
from modalmotion.errors import ParameterError, TopologyError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topology import CUP
from modalmotion.representation import Floats, shown
from modalmotion.template import Template

_REMEDY: Final = "State the fact tracking=material if they do (tagging, feature tracking)."


@shown("end_systole")
@dataclass(frozen=True, eq=False)
class Torsion:
    """Twist and shear of a wall since end diastole, degrees.

    Parameters
    ----------
    twist : (frames,) float64, degrees
        Rotation of the apical third of the wall about the axis from apex to base minus that of the
        basal third, right-handed: negative if the apex turns counterclockwise as seen from the
        apex.
    shear : (frames,) float64, degrees
        Mean change of the angle between lines along and around the wall, from circumferential
        towards longitudinal.
    twist_deviations, shear_deviations : (frames,) float64, degrees
        Standard deviation of both.
    end_diastole, end_systole : int
    """

    twist: Floats
    shear: Floats
    twist_deviations: Floats
    shear_deviations: Floats
    end_diastole: int
    end_systole: int


def torsion(
    sequence: MeshSequence, template: Template, end_diastole: int, end_systole: int
) -> Torsion:
    """Measure twist and shear of a wall.

    Parameters
    ----------
    sequence : MeshSequence
        Its facts state that its vertices follow the tissue.
    template : Template
    end_diastole, end_systole : int

    Raises
    ------
    ParameterError
        If it is not stated that the vertices follow the tissue, or there are too few.
    TopologyError
        If the surface is not a cup.
    """
    if sequence.facts.tracking != "material":
        raise ParameterError(
            "Torsion and shear need points that follow the tissue; whether these do is not stated.",
            remedy=_REMEDY,
        )
    if template.surface != CUP or template.landmarks is None:
        raise TopologyError(
            "Torsion is about the axis of a ventricle, from apex to base.",
            remedy="State the topology cup if the surface is a ventricle's wall.",
        )
    positions = sequence.vertices.astype(np.float64)
    positions -= positions[0].mean(axis=0)
    known = sequence.uncertainty
    wall, _ = smooth_walls(template, is_lattice=sequence.grid is not None)
    motion = WallMotion.of(positions, known, wall, end_diastole)
    twists = _twists(motion, template.landmarks.axis, end_diastole)
    shears = _shears(motion, end_diastole)
    return Torsion(
        twist=np.degrees(twists[0]),
        shear=np.degrees(shears[0]),
        twist_deviations=np.degrees(twists[1]),
        shear_deviations=np.degrees(shears[1]),
        end_diastole=end_diastole,
        end_systole=end_systole,
    )


def _twists(motion: WallMotion, axis: Floats, start: int) -> tuple[Floats, Floats]:
    """Twist of each frame and its standard deviation, radians.

    A ring's rotation is the angle of S = sum z conj(z0), z the position of its points about their
    mean across the axis, as complex numbers.
    """
    rows, columns = motion.places.shape
    grid = rows, columns, motion.n_frames, 3
    x = np.tensordot(motion.places.values, motion.coefficients, axes=1).reshape(grid)
    across = np.linalg.svd(axis[None])[2][1:]
    across[1] *= np.sign(np.cross(*across) @ axis)
    z = (x - x.mean(axis=1, keepdims=True)) @ (across[0] + 1j * across[1])
    third = np.minimum((3 * motion.places.ways).astype(int), 2)
    angles, gradients = [], []
    for part, sign in ((0, 1.0), (2, -1.0)):
        weights = np.where(third[:, None] == part, motion.weights, 0.0)
        S = np.einsum("rc,rcf,rc->f", weights, z, z[:, :, start].conj())
        angles.append(sign * np.angle(S))
        turned = sign * weights[:, :, None] * S.conj() * z[:, :, start, None].conj()
        turned /= np.abs(S) ** 2
        # Im(turned dz), dz = (e1 + i e2) . dx.
        gradients.append(turned.imag[..., None] * across[0] + turned.real[..., None] * across[1])
    total = np.sum(gradients, axis=0).reshape(rows * columns, motion.n_frames, 3)
    by_coefficients = np.tensordot(motion.places.values.T, total, axes=1)
    return np.sum(angles, axis=0), _errors(motion, by_coefficients, start)


def _shears(motion: WallMotion, start: int) -> tuple[Floats, Floats]:
    """Mean shear of each frame and its standard deviation, radians."""
    a, b = motion.slopes.along, motion.slopes.around
    sizes = [np.linalg.norm(x, axis=2, keepdims=True) for x in (a, b)]
    units = [x / np.where(size > 0, size, 1.0) for x, size in zip((a, b), sizes, strict=True)]
    cosine = (units[0] * units[1]).sum(axis=2, keepdims=True)
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 1e-12))
    weights = motion.weights.reshape(-1, 1)
    angles = (weights * np.arcsin(np.clip(cosine[..., 0], -1.0, 1.0))).sum(axis=0)
    total = np.zeros((motion.places.values.shape[1], motion.n_frames, 3))
    for own, other, size, shapes in (
        (units[0], units[1], sizes[0], motion.places.along),
        (units[1], units[0], sizes[1], motion.places.around),
    ):
        slope = (other - cosine * own) / (sine * np.where(size > 0, size, 1.0))
        total += np.tensordot(shapes.T, weights[:, :, None] * slope, axes=1)
    return angles - angles[start], _errors(motion, total, start)


def _errors(motion: WallMotion, gradients: Floats, start: int) -> Floats:
    """Return standard deviations of gradients (functions, frames, 3), for independent frames."""
    variances = np.array(
        [motion.variance(gradients[:, frame], frame) for frame in range(motion.n_frames)]
    )
    deviations = np.sqrt(variances + variances[start])
    deviations[start] = 0.0
    return np.asarray(deviations, dtype=np.float64)
