"""Pose of a simulated surface in the scanner, and its drift as a whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError
from modalmotion.representation import shown


@shown()
@dataclass(frozen=True)
class Pose:
    """Position and slow rigid motion of the whole surface.

    Parameters
    ----------
    rotation : (float, float, float), rad
        Rotation vector from the body frame, about the middle of the axis.
    translation : (float, float, float), mm
    drift_rotation : (float, float, float), rad
        Rotation vector that comes and goes once a beat, on top.
    drift_translation : (float, float, float), mm
        Translation that comes and goes once a beat, on top.

    Raises
    ------
    ParameterError
        If an entry is not finite.
    """

    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drift_rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drift_translation: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        entries = (self.rotation, self.translation, self.drift_rotation, self.drift_translation)
        if not np.isfinite(entries).all():
            raise ParameterError(
                f"The pose {entries} is not four finite vectors.",
                remedy="Give three finite numbers for each.",
            )

    def place(
        self,
        vertices: NDArray[np.float64],
        beats: NDArray[np.float64],
        middle: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Transform vertices from the body frame to the scanner's.

        Parameters
        ----------
        vertices : (frames, vertices, 3) float64, mm
        beats : (frames,) float64
            Time of each frame in beats.
        middle : (3,) float64, mm
            Fixed point of the rotations in the body frame.

        Returns
        -------
        (frames, vertices, 3) float64, mm
        """
        drift = (1.0 - np.cos(2 * np.pi * beats)) / 2
        fixed = rotation_matrix(np.asarray(self.rotation))
        placed = np.empty_like(vertices)
        for frame, share in enumerate(drift):
            turn = fixed @ rotation_matrix(share * np.asarray(self.drift_rotation))
            placed[frame] = (vertices[frame] - middle) @ turn.T
            placed[frame] += share * np.asarray(self.drift_translation)
        placed += middle + np.asarray(self.translation)
        return placed


def rotation_matrix(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation by |vector| rad about a vector, (3, 3) float64 (Rodrigues' formula)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # R = I + sin(a)/a K + (1 - cos(a))/a^2 K^2, with sinc(x) = sin(pi x) / (pi x)
    half = np.sinc(angle / (2 * np.pi))
    rotation: NDArray[np.float64] = np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * half**2 * K @ K
    return rotation


def random_rotation(rng: np.random.Generator) -> tuple[float, float, float]:
    """Rotation vector of a rotation drawn evenly from all of them."""
    q = rng.standard_normal(4)
    q *= np.copysign(1.0, q[0]) / np.linalg.norm(q)
    sine = float(np.linalg.norm(q[1:]))
    x, y, z = 2.0 * np.arctan2(sine, q[0]) * q[1:] / sine
    return float(x), float(y), float(z)
