"""The measurement's noise, estimated from a sequence itself.

Of each band the frames' products are read, in each of three directions of space. Noise fills all
directions of time alike once its correlation from frame to frame is taken out; a motion takes few
of them. These are sought in two of the directions of space and read in the third, whose noise knows
nothing of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.mesh.sequence import MeshSequence, Reference
from modalmotion.mesh.triangles import connectivity_of
from modalmotion.modes.topology import CLOSED
from modalmotion.numeric.products import LARGEST_SINGLE_THREADED, power_of_two, product
from modalmotion.signature.fitter import Fitter
from modalmotion.signature.model import Noise, over_time
from modalmotion.signature.nested_modes import Ladder, ladder_of
from modalmotion.signature.parameters import MOST_MODES
from modalmotion.template import Template
from modalmotion.template.body_frame import Components

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

    grams: NDArray[np.float64]
    expected: NDArray[np.float64]
    columns: NDArray[np.float64]
    scale: float
    modes: int

    @cached_property
    def _by_direction(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Directions of time, (3, frames, directions), and the bands' products along them.

        Those of most motion last. Each vertex's mean is left out: it takes the reference's own
        noise with it.
        """
        still = np.linalg.qr(np.ones((self.grams.shape[2], 1)), mode="complete")[0][:, 1:]
        totals = still.T @ self.grams.sum(axis=1) @ still
        directions = still @ np.linalg.eigh(totals.sum(axis=0) - totals)[1]
        turned = directions.transpose(0, 2, 1) @ self.grams.transpose(1, 0, 2, 3) @ directions
        return directions, turned

    def whitened(
        self, correlations: tuple[float, ...]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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
    fitter: Fitter, ladder: Ladder, coefficients: NDArray[np.float64], noise: SmoothNoise
) -> Bands:
    """Split a motion and fields of noise alike.

    Parameters
    ----------
    fitter : Fitter
        Of Cartesian components.
    ladder : Ladder
    coefficients : (frames, modes, 3) float64, length unit
        Of the ladder's largest set.
    noise : SmoothNoise
    """
    weights, f = fitter.template.weights, fitter.sequence.n_frames
    weighted = np.flatnonzero(weights > 0)
    most = max(1, min(_MODES, len(weighted) // _SHARE))
    m = int(ladder.counts[np.searchsorted(ladder.counts, most, side="right") - 1])
    # c = rows u, and u = psi c
    rows = ladder.basis.analysis[:m]
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
    left -= product(psi, c.reshape(m, -1)).reshape(left.shape)
    left *= np.sqrt(weights[some] / weights[some].sum())[:, None, None]
    # The first mode is a shift of the whole frame, which is motion.
    shift, n_bands = min(1, m - 1), max(1, m // _IN_BAND)
    paths = [*np.array_split(c[shift:], n_bands), left]
    # A small product for each direction: one thread does it.
    grams = [x.transpose(1, 2, 0) @ x.transpose(1, 0, 2) for x in paths]
    own = noise.coefficients(rows)
    bands = [products_of(part) for part in np.array_split(own[:, shift:], n_bands, axis=1)]
    # What orthonormal shapes leave has the products that theirs lack.
    parts = np.stack([*bands, products_of(noise.fields, weights) - products_of(own)], axis=1)
    variances = np.trace(parts, axis1=2, axis2=3) / parts.shape[2]
    columns = np.maximum(3.0 * independent(parts), 1.0)
    # What white noise brings is known: chance cancels in the ratio of smooth fields to white ones.
    squares = (rows[shift:] ** 2).sum(axis=1)
    white = np.array([part.sum() for part in np.array_split(squares, n_bands)])
    variances[:, :-1] *= white / variances[0, :-1]
    return Bands(np.stack(grams, axis=1), variances, columns, scale, m)


def likelihoods(
    energies: NDArray[np.float64],
    log_dets: NDArray[np.float64],
    columns: NDArray[np.float64],
    cost: float,
) -> NDArray[np.float64]:
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
    best: NDArray[np.float64] = found.max(axis=2).sum(axis=1)
    return best


def levels_of(
    energies: NDArray[np.float64],
    expected: NDArray[np.float64],
    columns: NDArray[np.float64],
    cost: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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


def _split(
    z: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Energy of noise, log-energies of motion, and directions of each, for 0, 1, ... of motion."""
    p = z.shape[-1]
    moving = np.arange(int(_MOVING * p) + 1)
    zero = np.zeros((*z.shape[:-1], 1))
    rest = np.concatenate([zero, np.cumsum(z, axis=-1)], axis=-1)[..., p - moving]
    own = np.concatenate([zero, np.cumsum(np.log(z[..., ::-1]), axis=-1)], axis=-1)[..., moving]
    return rest, own, (p - moving).astype(np.float64), moving.astype(np.float64)


# The first ladder; each further one is twice as long.
_FIRST: Final = 120

# Risk that is as good as the least one: it is flat about the best set.
_NEXT_TO_LEAST: Final = 1.02

# Correlations of a frame with the next that are compared.
_CORRELATIONS: Final = (
    *(-0.3, -0.15, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8),
    *(0.85, 0.9, 0.93, 0.96, 0.98),
)

# What a direction of motion costs in log-likelihood; without it all noise is called motion.
_COST: Final = 6.0

# Rounds of smoothness and correlation, each of which needs the other.
_ROUNDS: Final = 2

# Mixings up to here are all compared; those beyond grow by a factor, and are interpolated.
_GEOMETRIC: Final = 3

# Share of what lacks to 1 that the correlation may be off.
_SLOWER: Final = 0.1

# Frames from which on directions of time tell motion from noise.
_FEW_FRAMES: Final = 5

# How far the estimate may be off where nothing else shows.
_OFF: Final = 1.15


@dataclass(frozen=True, eq=False)
class Found:
    """What a noise was estimated by.

    Parameters
    ----------
    ladder : Ladder
    coefficients : (frames, modes, 3) float64, length unit
        Of the ladder's largest set.
    smooth : SmoothNoise
        On the same template.
    """

    ladder: Ladder
    coefficients: NDArray[np.float64]
    smooth: SmoothNoise


def measure_noise(fitter: Fitter) -> Noise:
    """Estimate a sequence's noise as its parameters measure displacements."""
    return with_ladder(fitter)[0]


def with_ladder(fitter: Fitter) -> tuple[Noise, Found]:
    """Estimate the noise, and give what it was estimated by."""
    plain = fitter.asking(components=Components.CARTESIAN)
    ladder = ladder_of(plain.template, _FIRST, plain.sequence.grid)
    smooth = SmoothNoise.on(plain.template)
    found = Found(ladder, plain.coefficients(ladder.basis), smooth)
    return estimate_noise(plain, found), found


def estimate_noise(fitter: Fitter, by: Found) -> Noise:
    """Estimate the noise's level, and its correlations in space and time.

    Taken for normal, of one level and one smoothness everywhere, and an autoregression of order 1
    over time.

    Parameters
    ----------
    fitter : Fitter
        Of Cartesian components.
    by : Found
    """
    sequence, weights = fitter.sequence, fitter.template.weights
    rounding, n_weighted = _rounding(sequence), int((weights > 0).sum())
    if sequence.n_frames < 2 or n_weighted < 2:
        return Noise(rounding, rounding, None, 0.0, 0.0, n_weighted, 0, rounding, 0)
    bands = bands_of(fitter, by.ladder, by.coefficients, by.smooth)
    if not bands.grams.max() > 0.0:
        return Noise(rounding, rounding, rounding, 0.0, 0.0, n_weighted, 0, rounding, bands.modes)
    variance, others, correlation, k = _variances(bands)
    sigma = bands.scale * float(np.sqrt(variance))
    lowest, highest = (bands.scale * float(np.sqrt(v)) for v in (min(others), max(others)))
    if sigma <= rounding:
        correlation, k = 0.0, 0
    white, smooth = independent(products_of(by.smooth.fields[[0, k]], weights))
    return Noise(
        sigma=max(sigma, rounding),
        lowest=max(lowest / _OFF, rounding),
        highest=max(highest * _OFF, rounding),
        between_frames=correlation,
        between_neighbours=by.smooth.beside(k) if k else 0.0,
        # Chance cancels in the ratio of smooth fields to white ones, whose number is known.
        independent_vertices=float(smooth / white / (weights**2).sum()),
        mixed=MIXINGS[k],
        rounding=rounding,
        modes=bands.modes,
    )


def _variances(bands: Bands) -> tuple[float, list[float], float, int]:
    """Variance, those by other rules that are as good, correlation in time and smoothness."""
    whitened = bands.whitened(_CORRELATIONS)

    def correlation(k: int, cost: float = _COST) -> float:
        found = likelihoods(*whitened, bands.columns[k], cost)
        return float(np.interp(_peak(found), np.arange(len(found)), _CORRELATIONS))

    def level(correlation: float, k: int, cost: float = _COST) -> tuple[float, int]:
        (energies,), _ = bands.whitened((correlation,))
        variances, found = levels_of(energies, bands.expected, bands.columns[k], cost)
        at = _peak(found)
        near = int(np.argmax(found))
        # Small numbers of mixings are all compared, and only beyond is anything between them.
        at = at if near > _GEOMETRIC else near
        return float(np.exp(np.interp(at, np.arange(len(found)), np.log(variances)))), near

    k = 0
    for _ in range(_ROUNDS):
        best = correlation(k)
        variance, k = level(best, k)
    others = [variance]
    others += [level(correlation(k, cost), k, cost)[0] for cost in (_COST / 2, _COST * 2)]
    (energies,), _ = bands.whitened((best,))
    half = len(energies) // 2
    for some in (slice(half), slice(half, None)):
        part = bands.expected[:, some], bands.columns[k][some]
        others.append(float(levels_of(energies[some], *part, _COST)[0][k]))
    # An autoregression is the slower the less of it the quick directions show.
    others += [level(best + off * (1.0 - abs(best)), k)[0] for off in (-_SLOWER, _SLOWER)]
    if bands.grams.shape[2] < _FEW_FRAMES:
        # So few are all motion where the modes are; what they leave is taken for independent.
        variance = float(energies[-1].mean()) / bands.expected[0, -1] / 3.0
        return variance, [variance, *others], 0.0, 0
    return variance, others, best, k


def _peak(found: NDArray[np.float64]) -> float:
    """Place of the largest likelihood, by a parabola through its neighbours."""
    k = int(np.argmax(found))
    if not 0 < k < len(found) - 1:
        return float(k)
    a, b, _ = np.polyfit([-1.0, 0.0, 1.0], found[k - 1 : k + 2] - found[k], 2)
    return k + (float(np.clip(-b / (2.0 * a), -0.5, 0.5)) if a < 0.0 else 0.0)


def modes_until_noise(fitter: Fitter, noise: Noise, by: Found) -> tuple[Ladder, int]:
    """Give a ladder of modes, and the number of them to keep.

    Parameters
    ----------
    fitter : Fitter
    noise : Noise
    by : Found
        What that was estimated by.
    """
    parameters, ladder, coefficients = fitter.parameters, by.ladder, by.coefficients
    n = _FIRST
    if parameters.components != Components.CARTESIAN:
        ladder, coefficients = _ladder(fitter, n)
    while True:
        shares = shares_of(ladder, by.smooth, noise.mixed)
        count = least_risk(ladder, coefficients, noise, shares, parameters.reference)
        if ladder.ends_because or n >= MOST_MODES or 4 * count <= 3 * ladder.counts[-1]:
            return ladder, count
        n = min(2 * n, MOST_MODES)
        ladder, coefficients = _ladder(fitter, n)


def _ladder(fitter: Fitter, n: int) -> tuple[Ladder, NDArray[np.float64]]:
    ladder = ladder_of(fitter.template, n, fitter.sequence.grid)
    return ladder, fitter.coefficients(ladder.basis)


def least_risk(
    ladder: Ladder,
    coefficients: NDArray[np.float64],
    noise: Noise,
    shares: NDArray[np.float64],
    reference: Reference,
) -> int:
    """Smallest whole set whose expected distance from the motion without noise is next to least.

    A mode that is kept brings its noise, one that is dropped takes its motion with it, whose
    square is the coefficient's less that of its noise: an unbiased risk (Mallows, Some comments
    on C_p, Technometrics, 1973). The motion is the displacement from the true reference, and
    carries the noise of its frame and of the reference.

    Parameters
    ----------
    ladder : Ladder
    coefficients : (frames, modes, n) float64, length unit
    noise : Noise
    shares : (modes,) float64
        Of each mode in noise of variance 1.
    reference : int or "mean"
    """
    f, scale = len(coefficients), power_of_two(float(np.abs(coefficients).max(initial=0.0)))
    variance = (noise.sigma / scale) ** 2
    squares = ((coefficients / scale) ** 2).sum(axis=(0, 2)) / f
    noises = 3.0 * noise.spread(f, reference) * variance * shares
    counts = ladder.counts
    motion = np.append(np.cumsum((squares - noises)[::-1])[::-1], 0.0)[counts]
    motion = np.maximum(motion, 0.0)
    kept_noise = np.concatenate([[0.0], np.cumsum(noises)])[counts]
    risk = motion + kept_noise
    return int(counts[int(np.argmax(risk <= _NEXT_TO_LEAST * risk.min()))])


def _rounding(sequence: MeshSequence) -> float:
    """Give the standard deviation that rounding to the stored type adds to a coordinate."""
    largest = float(np.abs(sequence.vertices).max(initial=0.0))
    step = float(np.spacing(sequence.vertices.dtype.type(largest)))
    return step / float(np.sqrt(12.0))
