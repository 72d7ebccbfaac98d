"""Noise that is smooth in space: white noise mixed with its neighbours, again and again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.choice.nested_sets import Ladder
from modalmotion.mesh.triangles import connectivity_of
from modalmotion.modes.topology import CLOSED
from modalmotion.numeric.products import LARGEST_SINGLE_THREADED, product
from modalmotion.template import Template

MIXINGS: Final = (0, 1, 2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64)
"""Times that a noise may have been mixed with its neighbours."""

# Numbers in the white fields that are mixed, and limits of the number of fields.
_NUMBERS: Final = 24_000
_FEWEST: Final = 16
_MOST: Final = 48


@dataclass(frozen=True, eq=False)
class SmoothNoise:
    """Fields of noise, ever smoother, of mean square 1 over the weighted vertices.

    Parameters
    ----------
    edges : (edges, 2) int64
        Neighbours.
    fields : (mixings, vertices, fields) float64
        Each is the mean of itself and its neighbours in the one before, once or several times.
    """

    edges: NDArray[np.int64]
    fields: NDArray[np.float64]

    @staticmethod
    def on(template: Template) -> SmoothNoise:
        """Draw fields on a template, the same each time."""
        edges, n = _edges_of(template), template.n_vertices
        rows = np.concatenate([edges[:, 0], edges[:, 1], np.arange(n)])
        columns = np.concatenate([edges[:, 1], edges[:, 0], np.arange(n)])
        share = 1.0 / np.bincount(rows, minlength=n)
        once = scipy.sparse.csr_array((share[rows], (rows, columns)), shape=(n, n))
        n_fields = int(np.clip(_NUMBERS // n, _FEWEST, _MOST))
        field = np.random.default_rng(0).standard_normal((n, n_fields))
        fields, counted = np.empty((len(MIXINGS), n, n_fields)), template.weights > 0
        n_counted = max(int(counted.sum()), 1) * n_fields
        for k, (before, times) in enumerate(zip((0, *MIXINGS), MIXINGS, strict=False)):
            for _ in range(times - before):
                field = once @ field
            squares = np.einsum("vf,vf->v", field, field) @ counted
            np.divide(field, np.sqrt(squares / n_counted), out=fields[k])
        return SmoothNoise(edges, fields)

    def coefficients(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Coefficients rows @ field of shapes, (mixings, modes, fields) float64."""
        return np.stack([product(rows, field) for field in self.fields])

    def beside(self, k: int) -> float:
        """Correlation of neighbours after `MIXINGS[k]` mixings."""
        if not len(self.edges):
            return 0.0
        # A thousand edges of each of dozens of fields tell it to a percent.
        x, y = (self.fields[k, i] for i in self.edges[:: -(-len(self.edges) // 1000)].T)
        return float((x * y).sum() / np.sqrt((x**2).sum() * (y**2).sum()))


def products_of(
    fields: NDArray[np.float64], weights: NDArray[np.float64] | float = 1.0
) -> NDArray[np.float64]:
    """Products of fields with one another over their columns, (mixings, fields, fields) float64.

    Parameters
    ----------
    fields : (mixings, columns, fields) float64
        Independent draws.
    weights : (columns,) float64 or float
    """
    rows = np.ascontiguousarray(fields.transpose(0, 2, 1))
    if rows[0].size * rows.shape[1] <= LARGEST_SINGLE_THREADED:
        return rows @ (rows * weights).transpose(0, 2, 1)
    return np.stack([product(x, np.ascontiguousarray((x * weights).T)) for x in rows])


def independent(products: NDArray[np.float64]) -> NDArray[np.float64]:
    """Independent columns that average like those of fields: tr(C)^2 / tr(C^2), C their covariance.

    Parameters
    ----------
    products : (..., fields, fields) float64
        From `products_of`.
    """
    n, own = products.shape[-1], np.diagonal(products, axis1=-2, axis2=-1)
    # E (x'y)^2 = tr(C^2) for independent fields x and y.
    squares = ((products**2).sum(axis=(-2, -1)) - (own**2).sum(axis=-1)) / (n * (n - 1))
    found: NDArray[np.float64] = own.mean(axis=-1) ** 2 / np.maximum(squares, 1e-300)
    return found


def shares_of(ladder: Ladder, noise: SmoothNoise, mixed: int) -> NDArray[np.float64]:
    """Give the expected squared coefficient of each mode in noise of variance 1, (modes,)."""
    white = ladder.noise_shares
    if mixed == 0:
        return white
    some = SmoothNoise(noise.edges, noise.fields[[0, MIXINGS.index(mixed)]])
    # Smooth fields stem from the white ones, so that chance cancels in their ratio.
    own, smooth = (some.coefficients(ladder.basis.analysis) ** 2).mean(axis=2)
    shares: NDArray[np.float64] = white * smooth / own
    return shares


def _edges_of(template: Template) -> NDArray[np.int64]:
    if len(template.faces):
        return connectivity_of(template.faces, template.n_vertices).edges
    i = np.arange(template.n_vertices)
    around = np.stack([i, np.roll(i, -1)], axis=1)
    is_closed = template.surface is not None and template.surface.ends == (CLOSED,)
    return around if is_closed and len(i) > 2 else around[:-1]
