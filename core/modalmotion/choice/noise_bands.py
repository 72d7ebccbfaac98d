"""A motion split into bands, coarse to fine, each with what it would hold of noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.choice.fitter import Fitter
from modalmotion.choice.nested_sets import Ladder
from modalmotion.choice.noise_mixtures import MIXINGS, PAIRED, Mixtures
from modalmotion.fit.fit import Fit
from modalmotion.numeric.products import product
from modalmotion.numeric.scale import power_of_two
from modalmotion.template import Template

# Modes that make bands, their largest share of the vertices, and their number in a band.
_MODES: Final = 120
_SHARE: Final = 4
_IN_BAND: Final = 10

FINE: Final = 3
"""Bands of what the modes leave."""

# Largest number of vertices in those and of frames: more do not change the estimate. The frames
# follow one another, or their correlation would be that of other steps.
_MOST_VERTICES: Final = 1500
_MOST_FRAMES: Final = 128


@dataclass(frozen=True, eq=False)
class Bands:
    """A motion split into bands, coarse to fine, each with what it would hold of noise.

    Parameters
    ----------
    grams : (bands, frames, frames) float64, in units of the scale squared
        Products of the frames with one another over the columns of each band.
    expected : (parts, bands) float64
        Sum of the columns' variances in noise of variance 1 that is mixed as `MIXINGS`.
    overlaps : (bands, parts, parts) float64
        Traces of products of the columns' covariances in two parts.
    modes : int
        Number that was taken out before the last bands.
    scale : float, length unit
        A power of two.
    """

    grams: NDArray[np.float64]
    expected: NDArray[np.float64]
    overlaps: NDArray[np.float64]
    modes: int
    scale: float

    def independent(self, parts: NDArray[np.float64]) -> NDArray[np.float64]:
        """Independent columns of each band, (bands,) float64, in noise of such parts.

        tr(C)^2 / tr(C^2) for columns of covariance C: their number where all are alike.
        """
        squares = np.einsum("a,nab,b->n", parts, self.overlaps, parts)
        n: NDArray[np.float64] = (parts @ self.expected) ** 2 / np.maximum(squares, 1e-300)
        return n


@dataclass(frozen=True, eq=False)
class _Split:
    """The split of fields (vertices, n) float64 on one surface.

    Parameters
    ----------
    rows : (modes, vertices) float64
        Coefficients of orthonormal shapes: c = rows u; those first that mixing changes least.
    psi : (vertices, modes) float64
        These shapes.
    once : (vertices, vertices) scipy.sparse.csr_array of float64
    some : (n,) int64
        Vertices that are read in the fine bands.
    """

    rows: NDArray[np.float64]
    psi: NDArray[np.float64]
    once: scipy.sparse.csr_array
    some: NDArray[np.int64]

    def coarse(self, c: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Split coefficients, (modes, n) float64."""
        return np.array_split(c, max(1, len(c) // _IN_BAND))

    def fine(
        self, fields: NDArray[np.float64], c: NDArray[np.float64]
    ) -> list[NDArray[np.float64]]:
        """Split what the modes leave, by means over ever more neighbours."""
        left = fields - product(self.psi, c)
        near = self.once @ left
        far = self.once @ (self.once @ (self.once @ near))
        root = np.sqrt(len(self.some))
        return [part[self.some] / root for part in (left - near, near - far, far)]


def n_modes_of(ladder: Ladder, template: Template) -> int:
    """Count the modes of a ladder that make bands."""
    most = max(1, min(_MODES, int((template.weights > 0).sum()) // _SHARE))
    return int(ladder.counts[np.searchsorted(ladder.counts, most, side="right") - 1])


def bands_of(fitter: Fitter, ladder: Ladder, fit: Fit, mixtures: Mixtures) -> Bands:
    """Split a motion and fields of noise alike.

    Parameters
    ----------
    fitter : Fitter
        Of Cartesian components.
    ladder : Ladder
    fit : Fit
        Of the ladder's largest set.
    mixtures : Mixtures
    """
    template, m = fitter.template, n_modes_of(ladder, fitter.template)
    triangle = np.ascontiguousarray(ladder.basis.triangle[:m])
    rows = product(triangle, ladder.basis.projector)
    kept = ((rows @ mixtures.once) ** 2).sum(axis=1) / (rows**2).sum(axis=1)
    order = np.argsort(-kept, kind="stable")
    weights = template.weights
    weighted = np.flatnonzero(weights > 0)
    psi = np.zeros((len(weights), m))
    psi[weighted] = rows[order][:, weighted].T / weights[weighted, None]
    split = _Split(
        np.ascontiguousarray(rows[order]),
        psi,
        mixtures.once,
        weighted[:: -(-len(weighted) // _MOST_VERTICES)],
    )
    scale, grams = _grams(fitter, fit, split, np.ascontiguousarray(triangle[order]))
    expected, overlaps = _expected(split, mixtures)
    if fitter.parameters.remove_rotation and m > 3:
        # A rotation takes three numbers a frame out of the coarsest band.
        expected[:, 0] *= 1.0 - 1.0 / len(split.coarse(split.rows)[0])
    return Bands(grams, expected, overlaps, m, scale)


def _grams(
    fitter: Fitter, fit: Fit, split: _Split, triangle: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64]]:
    f = fitter.sequence.n_frames
    first = max(0, (f - _MOST_FRAMES) // 2)
    last = min(f, first + _MOST_FRAMES)
    a = fit.amplitudes[first:last]
    size = max(float(fit.weighted_motion_rms.max()), float(np.abs(a).max(initial=0.0)))
    scale = power_of_two(size)
    # c = R a
    flat = np.ascontiguousarray((a / scale).transpose(1, 0, 2)).reshape(a.shape[1], -1)
    c = product(triangle, flat)
    fine: list[list[NDArray[np.float64]]] = [[] for _ in range(FINE)]
    for block in fitter.displacements.blocks():
        start, stop = max(block.frames.start, first), min(block.frames.stop, last)
        if start >= stop:
            continue
        u = block.u[start - block.frames.start : stop - block.frames.start]
        fields = u.transpose(2, 0, 1).reshape(u.shape[2], -1) * (block.shape.scale / scale)
        fields[fitter.template.weights == 0] = 0.0
        own = np.ascontiguousarray(c[:, 3 * (start - first) : 3 * (stop - first)])
        for parts, part in zip(fine, split.fine(fields, own), strict=True):
            parts.append(part)
    bands = [*split.coarse(c), *(np.concatenate(parts, axis=1) for parts in fine)]
    grams = []
    for band in bands:
        # (columns, frames * 3) -> (frames, columns * 3)
        x = np.ascontiguousarray(band.reshape(len(band), -1, 3).transpose(1, 0, 2))
        x = x.reshape(len(x), -1)
        grams.append(product(x, np.ascontiguousarray(x.T)))
    return scale, np.stack(grams)


def _expected(split: _Split, mixtures: Mixtures) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    parts = []
    for fields in mixtures.fields:
        c = product(split.rows, fields)
        parts.append([*split.coarse(c), *split.fine(fields, c)])
    n_parts, n_fields = len(MIXINGS), mixtures.fields.shape[2]
    expected = np.array([[(x**2).sum() / n_fields for x in part] for part in parts])
    overlaps = []
    k = PAIRED
    for band in zip(*parts, strict=True):
        x = np.concatenate([fields[:, :k] for fields in band], axis=1)
        squares = product(np.ascontiguousarray(x.T), x) ** 2
        squares = squares.reshape(n_parts, k, n_parts, k)
        # E (x'y)^2 = tr(C D) for independent fields x and y of covariances C and D
        same = np.einsum("akbk->ab", squares)
        overlaps.append((squares.sum(axis=(1, 3)) - same) / (k * (k - 1)))
    return expected, np.array(overlaps)
