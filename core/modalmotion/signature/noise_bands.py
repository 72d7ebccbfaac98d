"""A motion, and noise of any smoothness, in bands of modes.

Of each band the frames' products are read, in each of three directions of space. Noise fills all
directions of time alike once its correlation from frame to frame is taken out; a motion takes few
of them. These are sought in two of the directions of space and read in the third, whose noise knows
nothing of them.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import scipy

from modalmotion.mesh.triangles import connectivity_of
from modalmotion.modes.topologies import CLOSED
from modalmotion.numeric.scales import power_of_two
from modalmotion.representation import Floats, Ints
from modalmotion.signature.fit import Basis, Fitter
from modalmotion.signature.nested_modes import NestedModes
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

    edges: Ints
    fields: Floats

    @staticmethod
    def on(template: Template) -> "SmoothNoise":
        """Draw fields on a template, the same each time."""
        edges, n = edges_of(template), template.n_vertices
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

    def beside(self, k: int) -> float:
        """Correlation of neighbours after `MIXINGS[k]` mixings."""
        if not len(self.edges):
            return 0.0
        # A thousand edges of each of dozens of fields tell it to a percent.
        x, y = (self.fields[k, i] for i in self.edges[:: -(-len(self.edges) // 1000)].T)
        return float((x * y).sum() / np.sqrt((x**2).sum() * (y**2).sum()))


def products_of(fields: Floats, weights: Floats | float = 1.0) -> Floats:
    """Products of fields with one another over their columns, (mixings, fields, fields) float64.

    Parameters
    ----------
    fields : (mixings, columns, fields) float64
        Independent draws.
    weights : (columns,) float64 or float
    """
    rows = fields.transpose(0, 2, 1)
    return np.asarray(rows @ (rows * weights).transpose(0, 2, 1))


def independent(products: Floats) -> Floats:
    """Independent columns that average like those of fields: tr(C)^2 / tr(C^2), C their covariance.

    Parameters
    ----------
    products : (..., fields, fields) float64
        From `products_of`.
    """
    n, own = products.shape[-1], np.diagonal(products, axis1=-2, axis2=-1)
    # E (x'y)^2 = tr(C^2) for independent fields x and y.
    squares = ((products**2).sum(axis=(-2, -1)) - (own**2).sum(axis=-1)) / (n * (n - 1))
    return np.asarray(own.mean(axis=-1) ** 2 / np.maximum(squares, 1e-300))


def shares_of(basis: Basis, noise: SmoothNoise, mixed: int) -> Floats:
    """Give the expected squared coefficient of each mode in noise of variance 1, (modes,)."""
    # c = Q'W^(1/2) e, so E c_j^2 is the squared length of row j.
    white: Floats = (basis.analysis**2).sum(axis=1)
    if mixed == 0:
        return white
    # Smooth fields stem from the white ones, so that chance cancels in their ratio.
    own, smooth = (
        ((basis.analysis @ noise.fields[k]) ** 2).mean(axis=1) for k in (0, MIXINGS.index(mixed))
    )
    return np.asarray(white * smooth / own)


def edges_of(template: Template) -> Ints:
    """Pairs of neighbours on a template, (edges, 2) int64."""
    if len(template.faces):
        return connectivity_of(template.faces, template.n_vertices).edges
    i = np.arange(template.n_vertices)
    around = np.stack([i, np.roll(i, -1)], axis=1)
    is_closed = template.surface is not None and template.surface.ends == (CLOSED,)
    return around if is_closed and len(i) > 2 else around[:-1]


def over_time(correlation: float, n_frames: int) -> Floats:
    """Correlations of the noise of any two frames, (frames, frames) float64."""
    lags = np.abs(np.subtract.outer(np.arange(n_frames), np.arange(n_frames)))
    return np.asarray(np.float64(correlation) ** lags)


# Modes that make bands, their largest share of the vertices, and their number in a band.
_MODES: Final = 120
_SHARE: Final = 4
_IN_BAND: Final = 10

# Largest number of vertices in the residual and of frames: more do not change the estimate. The
# frames follow one another, or their correlation would be that of other steps.
_MOST_VERTICES: Final = 1500
_MOST_FRAMES: Final = 128

# Columns of a band that count at most: bands are not wholly alike.
_MOST_COLUMNS: Final = 400.0

# Share of the directions of time that a motion may take.
_MOVING: Final = 0.75

# Directions that are all mixtures of the principal directions of a motion, the first in each.
_MIXED: Final = np.array([[1, 1, 1], [1, -1, 0], [1, 1, -2]]) / np.sqrt([[3], [2], [6]])


@dataclass(frozen=True, eq=False)
class Bands:
    """A motion in bands of ten modes and what they leave, and what each would hold of noise.

    Parameters
    ----------
    grams : (3, bands, frames, frames) float64, in units of the scale squared
        Products of the frames with one another over the columns of each band.
    expected : (mixings, bands) float64
        Sum of the columns' variances in noise of variance 1.
    columns : (mixings, bands) float64
        Independent ones in such noise.
    scale : float, length unit
        A power of two.
    modes : int
    """

    grams: Floats
    expected: Floats
    columns: Floats
    scale: float
    modes: int

    @cached_property
    def _by_direction(self) -> tuple[Floats, Floats]:
        """Directions of time, (3, frames, directions), and the bands' products along them.

        Those of most motion last. Each vertex's mean is left out: it takes the reference's own
        noise with it.
        """
        still = np.linalg.qr(np.ones((self.grams.shape[2], 1)), mode="complete")[0][:, 1:]
        totals = still.T @ self.grams.sum(axis=1) @ still
        directions = still @ np.linalg.eigh(totals.sum(axis=0) - totals)[1]
        turned = directions.transpose(0, 2, 1) @ self.grams.transpose(1, 0, 2, 3) @ directions
        return directions, turned

    def whitened(self, correlations: tuple[float, ...]) -> tuple[Floats, Floats]:
        """Energies (correlations, bands, directions) and log det of each correlation."""
        directions, turned = self._by_direction
        covariances = np.stack([over_time(c, self.grams.shape[2]) for c in correlations])
        covariances = directions.transpose(0, 2, 1) @ covariances[:, None] @ directions
        # Each direction after those before it.
        L = np.linalg.cholesky(covariances)
        energies = [((inverse @ turned) * inverse).sum(axis=(1, 3)) for inverse in np.linalg.inv(L)]
        log_dets = 2.0 * np.log(np.diagonal(L, axis1=2, axis2=3)).sum(axis=(1, 2)) / 3.0
        return np.maximum(energies, 1e-280), log_dets


def bands_of(
    fitter: Fitter, nested: NestedModes, coefficients: Floats, noise: SmoothNoise
) -> Bands:
    """Split a motion and fields of noise alike.

    Parameters
    ----------
    fitter : Fitter
        Of Cartesian components.
    nested : NestedModes
    coefficients : (frames, modes, 3) float64, length unit
        Of the largest set.
    noise : SmoothNoise
    """
    weights, f = fitter.template.weights, fitter.sequence.n_frames
    weighted = np.flatnonzero(weights > 0)
    most = max(1, min(_MODES, len(weighted) // _SHARE))
    m = int(nested.counts[np.searchsorted(nested.counts, most, side="right") - 1])
    # c = rows u, and u = psi c
    rows = nested.basis.analysis[:m]
    some = weighted[:: -(-len(weighted) // _MOST_VERTICES)]
    psi = np.ascontiguousarray(rows[:, some].T / weights[some, None])
    first = max(0, (f - _MOST_FRAMES) // 2)
    last = min(f, first + _MOST_FRAMES)
    c = coefficients[first:last, :m]
    scale = power_of_two(float(np.abs(c).max(initial=0.0)))
    c = c / scale
    off = (c - c.mean(axis=0)).reshape(-1, 3)
    turn = np.linalg.eigh(off.T @ off)[1][:, ::-1] @ _MIXED
    n = last - first
    c = np.ascontiguousarray((c @ turn).transpose(1, 2, 0))
    left = np.empty((len(some), 3, n))
    for block in fitter.displacements.blocks():
        start, stop = max(block.frames.start, first), min(block.frames.stop, last)
        if start < stop:
            u = block.u[start - block.frames.start : stop - block.frames.start][:, :, some]
            u = turn.T @ u * (block.shape.scale / scale)
            left[:, :, start - first : stop - first] = u.transpose(2, 1, 0)
    left -= (psi @ c.reshape(m, -1)).reshape(left.shape)
    left *= np.sqrt(weights[some] / weights[some].sum())[:, None, None]
    # The first mode is a shift of the whole frame, which is motion.
    shift, n_bands = min(1, m - 1), max(1, m // _IN_BAND)
    paths = [*np.array_split(c[shift:], n_bands), left]
    # A small product for each direction: one thread does it.
    grams = [x.transpose(1, 2, 0) @ x.transpose(1, 0, 2) for x in paths]
    own = np.stack([rows @ field for field in noise.fields])
    bands = [products_of(part) for part in np.array_split(own[:, shift:], n_bands, axis=1)]
    # What orthonormal shapes leave has the products that theirs lack.
    parts = np.stack([*bands, products_of(noise.fields, weights) - products_of(own)], axis=1)
    variances = np.trace(parts, axis1=2, axis2=3) / parts.shape[2]
    # The smoothest noise leaves less beyond the modes of a lattice than the difference's rounding.
    least = 8.0 * np.finfo(np.float64).eps * variances.max(axis=1, keepdims=True)
    variances = np.maximum(variances, least)
    columns = np.maximum(3.0 * independent(parts), 1.0)
    # What white noise brings is known: chance cancels in the ratio of smooth fields to white ones.
    squares = (rows[shift:] ** 2).sum(axis=1)
    white = np.array([part.sum() for part in np.array_split(squares, n_bands)])
    variances[:, :-1] *= white / variances[0, :-1]
    return Bands(np.stack(grams, axis=1), variances, columns, scale, m)


def likelihoods(energies: Floats, log_dets: Floats, columns: Floats, cost: float) -> Floats:
    """Log-likelihood of each correlation where each band has a level of its own.

    In each band the directions of most motion have energies of their own, as many as pay their
    cost.

    Parameters
    ----------
    energies : (correlations, bands, directions) float64
    log_dets : (correlations,) float64
        Of the correlation at which they are white.
    columns : (bands,) float64
    cost : float
        Of each direction of motion.
    """
    n = np.minimum(columns, _MOST_COLUMNS)
    rest, own, noises, moving = _split(energies / columns[:, None])
    with np.errstate(divide="ignore", invalid="ignore"):
        levels = np.where(noises > 0, noises * np.log(rest / noises), 0.0)
    found = -0.5 * n[:, None] * (levels + own + log_dets[:, None, None]) - cost * moving
    return np.asarray(found.max(axis=2).sum(axis=1))


def levels_of(
    energies: Floats, expected: Floats, columns: Floats, cost: float
) -> tuple[Floats, Floats]:
    """Variance of the noise in all bands together, and its log-likelihood, for each mixing.

    Parameters
    ----------
    energies : (bands, directions) float64
    expected : (mixings, bands) float64
    columns : (bands,) float64
    cost : float

    Returns
    -------
    variances, likelihoods : (mixings,) float64
    """
    n = np.minimum(columns, _MOST_COLUMNS)
    rest, own, noises, moving = _split(energies / expected[:, :, None] / 3.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        variances = np.einsum("b,kbr->kr", n, rest) / (n.sum() * noises)
        levels = np.where(noises > 0, noises * (np.log(variances) + 1.0), 0.0)
    found = n.sum() * (levels + moving) + np.einsum("b,kbr->kr", n, own)
    found = -0.5 * (found + energies.shape[1] * (np.log(expected) @ n)[:, None])
    found -= cost * moving
    best = found.argmax(axis=1)[:, None]
    return (
        np.take_along_axis(variances, best, axis=1)[:, 0],
        np.take_along_axis(found, best, axis=1)[:, 0],
    )


def _split(z: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Energy of noise, log-energies of motion, and directions of each, for 0, 1, ... of motion."""
    p = z.shape[-1]
    moving = np.arange(int(_MOVING * p) + 1)
    zero = np.zeros((*z.shape[:-1], 1))
    rest = np.concatenate([zero, np.cumsum(z, axis=-1)], axis=-1)[..., p - moving]
    own = np.concatenate([zero, np.cumsum(np.log(z[..., ::-1]), axis=-1)], axis=-1)[..., moving]
    return rest, own, (p - moving).astype(np.float64), moving.astype(np.float64)
