"""Rotations as glTF stores them: unit quaternions (x, y, z, w)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def to_quaternions(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn rotations over time into quaternions without jumps of sign.

    Parameters
    ----------
    matrices : (frames, 3, 3) float64

    Returns
    -------
    (frames, 4) float64
        Each on the same side as the one before, so that a player turns the short way.

    Notes
    -----
    Shepperd, Quaternion from rotation matrix, Journal of Guidance and Control, 1981.
    """
    R = matrices
    trace = np.trace(R, axis1=1, axis2=2)
    # 4 q_i^2, for x, y, z and w: dividing by the largest of them loses no digits.
    squares = 1.0 + np.stack([2.0 * R[:, i, i] - trace for i in range(3)] + [trace], axis=1)
    largest = squares.argmax(axis=1)
    rows = np.arange(len(R))
    # 4 q_i q_j for all pairs.
    products = np.empty((len(R), 4, 4))
    products[:, range(4), range(4)] = squares
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        products[:, i, j] = products[:, j, i] = R[:, i, j] + R[:, j, i]
        products[:, k, 3] = products[:, 3, k] = R[:, j, i] - R[:, i, j]
    quaternions: NDArray[np.float64] = products[rows, largest]
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    turns = np.sign((quaternions[1:] * quaternions[:-1]).sum(axis=1))
    turns[turns == 0] = 1.0
    quaternions[1:] *= np.cumprod(turns)[:, None]
    return quaternions


def to_matrices(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn quaternions of any length but zero into rotations.

    Parameters
    ----------
    quaternions : (n, 4) float64

    Returns
    -------
    (n, 3, 3) float64
    """
    x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def slerp(
    start: NDArray[np.float64], end: NDArray[np.float64], part: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Go from one quaternion to another along the shorter arc at constant speed.

    Parameters
    ----------
    start, end : (n, 4) float64
        Of unit length.
    part : (n, 1) float64
        0 at the start, 1 at the end.

    Returns
    -------
    (n, 4) float64

    Notes
    -----
    Shoemake, Animating rotation with quaternion curves, SIGGRAPH 1985.
    """
    dot = (start * end).sum(axis=1, keepdims=True)
    end = np.where(dot < 0, -end, end)
    angle = np.arccos(np.clip(np.abs(dot), 0.0, 1.0))
    sine = np.sin(angle)
    # Nearly the same rotation: the arc is straight to the last digit.
    is_straight = sine < 1e-9
    safe = np.where(is_straight, 1.0, sine)
    a = np.where(is_straight, 1.0 - part, np.sin((1.0 - part) * angle) / safe)
    b = np.where(is_straight, part, np.sin(part * angle) / safe)
    result: NDArray[np.float64] = a * start + b * end
    return result
