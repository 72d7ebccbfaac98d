"""Affine motions of a template, which a few modes cannot hold exactly, and mode shapes that do.

A heart that contracts evenly moves by an affine map. Modes leave a part of that, which points
outward at the ends and biases volumes to one side. The amplitudes of every affine map are known
from the reference alone, though, so what the modes leave of it can go with them.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.numeric.cholesky import gram, inverse_of_cholesky
from modalmotion.numeric.products import product, second_moments, weighted_sum
from modalmotion.template.loose_vertices import nearest_in_use
from modalmotion.template.template import Template

HELD: Final = 0.5
"""Share of an affine motion's RMS: motions of which the modes hold less are left to the modes,
whose amplitudes say too little about them."""

# Of the longest axis: a surface thinner than this has no extent in that direction.
_THIN: Final = 1e-6

# Of the mean of the diagonal: keeps shapes apart that few vertices cannot tell apart.
_RIDGE: Final = 1e-12


def unit_coordinates(
    rest: NDArray[np.float64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Coordinates along the principal axes and 1, each with mean square 1 and uncorrelated.

    Parameters
    ----------
    rest : (vertices, 3) float64
        In a unit in which they are of size 1, or nearly so.
    weights : (vertices,) float64
        Their sum is 1.

    Returns
    -------
    (vertices, 4) float64, 1
        Fewer columns where the surface has no extent in a direction.
    """
    y = rest - weighted_sum(weights, rest)
    squares, axes = np.linalg.eigh(second_moments(weights, y, y))
    wide = squares > _THIN**2 * squares[-1]
    along = product(y, axes[:, wide] / np.sqrt(squares[wide]))
    return np.concatenate([along, np.ones((len(y), 1))], axis=1)


def affine_shapes(shapes: NDArray[np.float64], template: Template) -> NDArray[np.float64]:
    """Mode shapes whose superposition is exact for affine motions.

    Parameters
    ----------
    shapes : (vertices, modes) float64
        Phi, with mean square 1.
    template : Template

    Returns
    -------
    (vertices, modes) float64
        What is superposed has the same amplitudes, by weighted least squares, as before.

    Notes
    -----
    A motion moves each direction by a combination c of the unit coordinates q, with the amplitudes
    P q c, P the projector on the modes. The other way round amplitudes a belong to c = (P q)^+ a,
    of which the modes leave (q - Phi P q) c. That is added: Phi + (q - Phi P q) (P q)^+. As P of
    what is left is zero, the amplitudes stay. The same holds in each direction, so that one
    matrix serves all three.
    """
    w, size = template.weights, float(np.abs(template.vertices).max(initial=0.0))
    if not size > 0:
        return shapes
    q = unit_coordinates(template.vertices / size, w)
    weighted = np.ascontiguousarray((w[:, None] * shapes).T)
    G = product(weighted, shapes)
    G[np.diag_indices(len(G))] += _RIDGE * np.trace(G) / len(G)
    held = product(gram(inverse_of_cholesky(G)), product(weighted, q))
    # (P q)^+ over the combinations that the modes hold: S^2 are the eigenvalues of (P q)' P q.
    squares, V = np.linalg.eigh(product(np.ascontiguousarray(held.T), held))
    V, squares = V[:, squares > HELD**2], squares[squares > HELD**2]
    if not len(squares):
        return shapes
    inverse = product(product(V / squares, np.ascontiguousarray(V.T)), np.ascontiguousarray(held.T))
    whole = shapes + product(q - product(shapes, held), inverse)
    if len(template.isolated):
        whole[template.isolated] = whole[nearest_in_use(template.vertices, template.isolated)]
    return whole
