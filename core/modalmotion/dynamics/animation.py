"""Animation: any shape moved by modes, one frame after the other.

As figures 2 and 3 of Nastar (1994). The modes may be of anything: shapes at the nodes of a
lattice or at the vertices of a mesh serve alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ShapeError
from modalmotion.numeric.products import product

Array = NDArray[np.float64]


def directional_mode(shape: Array, direction: Array) -> Array:
    """Displacements of a mode along one direction.

    Parameters
    ----------
    shape : (vertices,) float64
        One column of a shape matrix.
    direction : (3,) or (vertices, 3) float64
        A unit vector for all vertices, or one for each, such as their normals.

    Returns
    -------
    (vertices, 3) float64

    Raises
    ------
    ShapeError
        If the direction has another shape.
    """
    phi = np.asarray(shape, dtype=np.float64)
    if phi.ndim != 1:
        raise ShapeError(
            f"A mode has the shape (vertices,), not {phi.shape}.",
            remedy="Take one column of the shape matrix.",
        )
    return phi[:, None] * _require_direction(direction, len(phi))


def animate_along(
    reference: Array, shapes: Array, amplitudes: Iterable[Array], direction: Array
) -> Iterator[Array]:
    """Positions of a shape that moves by directional modes.

    Parameters
    ----------
    reference : (vertices, 3) float64, mm
    shapes : (vertices, modes) float64
    amplitudes : iterable of (modes,) float64, mm
        One for each frame.
    direction : (3,) or (vertices, 3) float64
        A unit vector for all vertices, or one for each, such as their normals.

    Yields
    ------
    (vertices, 3) float64, mm

    Raises
    ------
    ShapeError
        If the arrays do not fit; names the frame.
    """
    X, phi = _require_basis(reference, shapes)
    d = _require_direction(direction, len(X))
    # (2) x = X + sum_m a_m phi_m d
    return (X + product(phi, a[:, None]) * d for a in _each(amplitudes, (phi.shape[1],)))


def _each(amplitudes: Iterable[Array], shape: tuple[int, ...]) -> Iterator[Array]:
    for frame, values in enumerate(amplitudes):
        a = np.asarray(values, dtype=np.float64)
        if a.shape != shape:
            raise ShapeError(
                f"The amplitudes of frame {frame} have the shape {a.shape}, not {shape}.",
                remedy="Give one amplitude for each mode and direction.",
                frame=frame,
            )
        yield a


def _require_basis(reference: Array, shapes: Array) -> tuple[Array, Array]:
    X, phi = (np.asarray(a, dtype=np.float64) for a in (reference, shapes))
    if X.ndim != 2 or X.shape[1] != 3 or phi.ndim != 2 or len(phi) != len(X):
        raise ShapeError(
            f"A reference of shape {X.shape} cannot move by shapes of shape {phi.shape}.",
            remedy="Give (vertices, 3) and (vertices, modes).",
        )
    return X, phi


def _require_direction(direction: Array, n_vertices: int) -> Array:
    d = np.asarray(direction, dtype=np.float64)
    if d.shape not in ((3,), (n_vertices, 3)):
        raise ShapeError(
            f"A direction of shape {d.shape} for {n_vertices} vertices.",
            remedy="Give one vector, (3,), or one for each vertex.",
        )
    return d
