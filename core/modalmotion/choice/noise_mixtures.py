"""Noise that is smooth in space: white noise mixed with its neighbours, again and again.

Mixing once replaces each vertex by the mean of itself and its neighbours. Whatever made a noise
smooth, its energy falls from coarse to fine, and a sum of independent parts, each mixed another
number of times, falls like it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.choice.nested_sets import Ladder
from modalmotion.mesh.connectivity import connectivity_of
from modalmotion.modes.topology import CLOSED
from modalmotion.numeric.products import product
from modalmotion.template import Template

MIXINGS: Final = (0, 1, 2, 4, 8, 12, 16, 24, 32, 48, 64)
"""Times that each part of a noise was mixed with its neighbours."""

# Numbers in the white fields that are mixed, and limits of the number of fields.
_NUMBERS: Final = 64_000
_FEWEST: Final = 16
_MOST: Final = 48

PAIRED: Final = 12
"""Fields whose products with one another are taken."""


@dataclass(frozen=True, eq=False)
class Mixtures:
    """White fields, mixed with their neighbours.

    Parameters
    ----------
    edges : (edges, 2) int64
        Neighbours.
    once : (vertices, vertices) scipy.sparse.csr_array of float64
        Mixes fields once.
    fields : (parts, vertices, fields) float64
        Of mean square 1 over the weighted vertices, mixed as `MIXINGS`.
    """

    edges: NDArray[np.int64]
    once: scipy.sparse.csr_array
    fields: NDArray[np.float64]

    @staticmethod
    def of(template: Template) -> Mixtures:
        """Draw fields on a template, the same each time."""
        edges, n = _edges_of(template), template.n_vertices
        itself = np.arange(n)
        rows = np.concatenate([edges[:, 0], edges[:, 1], itself])
        columns = np.concatenate([edges[:, 1], edges[:, 0], itself])
        share = 1.0 / np.bincount(rows, minlength=n)
        once = scipy.sparse.csr_array((share[rows], (rows, columns)), shape=(n, n))
        n_fields = int(np.clip(_NUMBERS // n, _FEWEST, _MOST))
        field = np.random.default_rng(0).standard_normal((n, n_fields))
        weighted = template.weights > 0
        fields = np.empty((len(MIXINGS), *field.shape))
        for k, times in enumerate(MIXINGS):
            for _ in range(times - (MIXINGS[k - 1] if k else 0)):
                field = once @ field
            fields[k] = field / np.sqrt((field[weighted] ** 2).mean())
        return Mixtures(edges, once, fields)

    def beside(self) -> NDArray[np.float64]:
        """Correlation of neighbours in each part, (parts,) float64."""
        if not len(self.edges):
            return np.zeros(len(MIXINGS))
        # A thousand edges of each of dozens of fields tell it to a percent.
        i, j = self.edges[:: -(-len(self.edges) // 1000)].T
        x, y = self.fields[:, i], self.fields[:, j]
        result: NDArray[np.float64] = (x * y).sum(axis=(1, 2)) / np.sqrt(
            (x**2).sum(axis=(1, 2)) * (y**2).sum(axis=(1, 2))
        )
        return result

    def independent(self, parts: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
        """Vertices of independent noise that average like all: tr(C)^2 / tr(C^2) by weight."""
        n_parts, n, k = len(MIXINGS), len(weights), PAIRED
        x = np.ascontiguousarray(self.fields[:, :, :k].transpose(1, 0, 2)).reshape(n, -1)
        squares = product(np.ascontiguousarray((x * weights[:, None]).T), x) ** 2
        squares = squares.reshape(n_parts, k, n_parts, k)
        overlaps = squares.sum(axis=(1, 3)) - np.einsum("akbk->ab", squares)
        return float(k * (k - 1) / max(parts @ overlaps @ parts, 1e-300))

    def shares(self, ladder: Ladder, parts: NDArray[np.float64]) -> NDArray[np.float64]:
        """Give the expected squared coefficient of each mode in noise of variance 1.

        Parameters
        ----------
        ladder : Ladder
        parts : (parts,) float64
            Share of each in the variance.

        Returns
        -------
        (modes,) float64
        """
        white = ladder.noise_shares
        if parts[0] == 1.0:
            return white
        rows = product(ladder.basis.triangle, ladder.basis.projector)
        squares = np.stack([(product(rows, x) ** 2).mean(axis=1) for x in self.fields[parts > 0]])
        own = (product(rows, self.fields[0]) ** 2).mean(axis=1)
        # Mixed fields stem from the white ones, so that chance cancels in their ratio.
        shares: NDArray[np.float64] = white * (parts[parts > 0] @ squares) / own
        return shares


def _edges_of(template: Template) -> NDArray[np.int64]:
    if len(template.faces):
        return connectivity_of(template.faces, template.n_vertices).edges
    i = np.arange(template.n_vertices)
    around = np.stack([i, np.roll(i, -1)], axis=1)
    is_closed = template.surface is not None and template.surface.ends == (CLOSED,)
    return around if is_closed and len(i) > 2 else around[:-1]
