"""How unevenly the segments of a ventricle contract in time.

The systolic dyssynchrony index is the standard deviation of the times at which the volumes of the
16 segments are smallest, percent of the cycle (Kapetanakis et al., Circulation, 2005).
"""

from typing import Final

import numpy as np
import scipy

from modalmotion.clinical import segments, volume_curve
from modalmotion.clinical.wall_motion import WallMotion
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import Floats, Ints

N_SECTORS: Final = 16
"""Segments without the tip."""

# Largest share of a cycle between two frames, over its end too.
_LARGEST_GAP: Final = 1 / 8 + 1e-9

# Instants of a cycle among which the smallest volume is searched.
_INSTANTS: Final = np.arange(1000) / 1000

# From an instant to the exact time of the smallest volume.
_NEWTON_STEPS: Final = 2

# Of the noise of volumes, always the same, and of the power of what segments do apart.
_DRAWS: Final = 100
_POWERS: Final = 20
_SEED: Final = 16

# Harmonics of a cycle at most, and the least variance of a volume, of its mean square.
_HARMONICS: Final = 25
_LEAST: Final = 1e-10


def phases_of(sequence: MeshSequence) -> Floats:
    """Instants of the frames as shares of the cycle, which ends a step after them if unstated."""
    n = sequence.n_frames
    times = np.arange(n, dtype=np.float64) if sequence.times is None else sequence.times
    times = times - times[0]
    stated = None if sequence.times is None else sequence.facts.period
    period = stated or times[-1] * n / max(n - 1, 1) or 1.0
    return np.asarray(times / period, dtype=np.float64)


def sectors_of(motion: WallMotion) -> Ints:
    """Sector of each place of a cup, -1 at its tip: 16 like the segments, of any zero of theta."""
    rings = segments.rings_of(np.repeat(motion.places.ways, motion.places.shape[1]))
    turns = motion.places.theta
    six, four = np.floor(6 * turns).astype(int), np.floor(4 * turns).astype(int)
    return np.choose(rings, [six, 6 + six, 12 + four, np.full_like(six, -1)])


def segment_volumes(motion: WallMotion, segment: Ints, n: int) -> tuple[Floats, Floats]:
    """Measure the volume between each segment of the wall and the middle line of the cavity.

    Parameters
    ----------
    motion : WallMotion
    segment : (places,) int64
    n : int
        Segments.

    Returns
    -------
    volumes : (frames, n) float64, length unit cubed
    gradients : (frames, functions, n, 3) float64, length unit squared
        By the coefficients of each frame.
    """
    frames = range(motion.n_frames)
    gradients = np.array([_volume_gradients(motion, segment, n, frame) for frame in frames])
    # A volume is of the third degree in the coefficients: V(c) = c . V'(c) / 3.
    volumes = np.einsum("fknj,kfj->fn", gradients, motion.coefficients) / 3.0
    sign = np.sign(volumes.sum())
    return sign * volumes, sign * gradients


def _volume_gradients(motion: WallMotion, segment: Ints, n: int, frame: int) -> Floats:
    """Differentiate each segment's volume by the coefficients of a frame, (functions, n, 3).

    Of either sign, a sum of (a x g) . l / 2, with a from the middle line to
    the wall, g around it and l along the middle line.
    """
    rows, columns = motion.places.shape
    grid = rows, columns, 3
    x = (motion.places.values @ motion.coefficients[:, frame]).reshape(grid)
    a = x - x.mean(axis=1, keepdims=True)
    g = motion.slopes.around[:, frame].reshape(grid)
    l = motion.slopes.along[:, frame].reshape(grid).mean(axis=1, keepdims=True)  # noqa: E741
    half = motion.weights[:, :, None] / 2.0
    by_a, by_g, by_l = half * np.cross(g, l), half * np.cross(l, a), half * np.cross(a, g)
    own = (segment[:, None] == np.arange(n)).reshape(rows, columns, n, 1)
    of_x, of_g, of_l = (own * each[:, :, None] for each in (by_a, by_g, by_l))
    of_x -= of_x.mean(axis=1, keepdims=True)
    of_l = np.broadcast_to(of_l.mean(axis=1, keepdims=True), (*own.shape[:3], 3))
    places, gradients = motion.places, np.zeros((motion.places.values.shape[1], n, 3))
    for shapes, each in ((places.values, of_x), (places.around, of_g), (places.along, of_l)):
        gradients += np.tensordot(shapes.T, each.reshape(rows * columns, n, 3), axes=1)
    return gradients


def volume_variances(motion: WallMotion, gradients: Floats) -> Floats:
    """Variance of each segment's volume from the errors of positions, (frames, n) float64.

    Without those of a track along the surface, which would move the borders of segments: these keep
    their heights.
    """
    n = gradients.shape[2]
    return np.array(
        [
            [motion.variance(own[:, k], frame, is_row=n > 1) for k in range(n)]
            for frame, own in enumerate(gradients)
        ]
    )


def dyssynchrony(
    volumes: Floats, phases: Floats, variances: Floats, *, is_smooth: bool = False
) -> tuple[float, float, float] | None:
    """Measure the spread of the times of smallest volume.

    Parameters
    ----------
    volumes : (frames, segments) float64
    phases : (frames,) float64
        Of one cycle, 0 to 1.
    variances : (frames, segments) float64
        Of the noise of the volumes.
    is_smooth : bool
        Whether errors of neighbouring frames are alike, as those of a track are. Nothing of the
        volumes is noise then, and the interval alone includes the errors, drawn with the spectrum
        of the motion.

    Returns
    -------
    (float, float, float) or None
        Standard deviation of the times, and its 95 % interval, percent of the cycle. None if more
        than an eighth of the cycle is between two frames.

    Notes
    -----
    Each segment follows the whole volume in its share, plus a rest. The index is the mean over
    curves drawn given the data (see `_curves`): the likeliest curves alone would be too much alike,
    and those of the data too little. The interval includes the deviation of draws whose powers are
    drawn too, what draws add to the likeliest curves, the difference from straight lines between
    the frames, and the spacing of the frames. Below the index of a track it includes what its
    errors make of segments that all follow the whole, above what they add to the index.
    """
    if (closed := _cycle(phases)) is None:
        return None
    phases, gaps, n = closed[:-1], np.diff(closed), len(closed) - 1
    volumes, variances = volumes[:n], variances[:n]
    splines = _splines(closed)(_INSTANTS)
    lines = scipy.interpolate.interp1d(closed, _by_frame(n), axis=0)(_INSTANTS)
    rng = np.random.default_rng(_SEED)

    def apart(drawn: Floats) -> Floats:
        return np.array([_apart(splines @ each) for each in drawn])

    if is_smooth:
        smooth, noise = volumes, _alike_in_time(volumes, rng) * np.sqrt(variances)
        value = likeliest = _apart(splines @ volumes)
        alike, more = apart(_parts(volumes)[0] + noise), apart(volumes + noise)
        less = np.sqrt(max(value**2 - (alike**2).mean(), 0.0))
        below = alike.var() + (value - less) ** 2
        above = more.var() + (np.sqrt((more**2).mean()) - value) ** 2
    else:
        smooth, drawn, wider = _curves(volumes, phases, variances, rng)
        value, likeliest = apart(drawn).mean(), _apart(splines @ smooth)
        below = above = ((apart(wider) - value) ** 2).mean() + (value - likeliest) ** 2
    by_lines = _apart(lines @ smooth) - likeliest
    # Of the deviation of n times that are each uniform between two frames.
    by_frames = gaps.mean() / np.sqrt(12.0 * 2.0 * (volumes.shape[1] - 1))
    squares = np.array([below, above]) + by_lines**2 + by_frames**2
    down, up = volume_curve.TWO_DEVIATIONS * np.sqrt(squares)
    value, low, high = 100.0 * np.maximum([value, value - down, value + up], 0.0)
    return float(value), float(low), float(high)


def index_gradient(volumes: Floats, phases: Floats) -> Floats | None:
    """Differentiate the index of volumes without noise by each of them.

    Parameters
    ----------
    volumes : (frames, segments) float64
    phases : (frames,) float64

    Returns
    -------
    (frames, segments) float64, percent of the cycle per unit of volume, or None
        None if there is no index, or the times do not differ.

    Notes
    -----
    Where a curve f is least f'(t) is 0, so dt = -df'(t) / f''(t).
    """
    if (closed := _cycle(phases)) is None:
        return None
    n, splines = len(closed) - 1, _splines(closed)
    times = _INSTANTS[(splines(_INSTANTS) @ volumes[:n]).argmin(axis=0)]
    for _ in range(_NEWTON_STEPS):
        slopes, curvatures = (
            (splines(times, order) * volumes[:n].T).sum(axis=1) for order in (1, 2)
        )
        curvatures = np.where(curvatures > 0.0, curvatures, np.inf)
        times = np.mod(times - slopes / curvatures, 1.0)
    away = _about_mean(times)
    spread = float(away.std(ddof=1))
    if not spread > _INSTANTS[1]:
        return None
    by_time = 100.0 * (away - away.mean()) / ((len(away) - 1) * spread)
    gradient: Floats = np.zeros(volumes.shape)
    gradient[:n] = (-splines(times, 1) * (by_time / curvatures)[:, None]).T
    return gradient


def _cycle(phases: Floats) -> Floats | None:
    """Phases of one cycle from 0 to 1, (frames + 1,); None if frames are too far apart."""
    phases = phases - phases[0]
    closed = np.append(phases[phases < 1.0 - 1e-9], 1.0)  # without a repeated first frame
    gaps = np.diff(closed)
    return None if gaps.max() > _LARGEST_GAP or gaps.min() <= 0.0 else closed


def _splines(closed: Floats) -> "scipy.interpolate.CubicSpline":
    """Periodic splines of curves that are 1 in one frame and 0 in the others."""
    return scipy.interpolate.CubicSpline(closed, _by_frame(len(closed) - 1), bc_type="periodic")


def _by_frame(n: int) -> Floats:
    """Values at the n frames of a cycle and at its end, of a unit of each."""
    frames: Floats = np.eye(n)
    return frames.take(np.arange(n + 1) % n, axis=0)


def _alike_in_time(volumes: Floats, rng: "np.random.Generator") -> Floats:
    """Draw noise of variance 1 with the spectrum of the motion, (draws, frames, segments)."""
    moving = np.fft.rfft(volumes - volumes.mean(axis=0), axis=0)
    sizes = np.sqrt((np.abs(moving) ** 2).mean(axis=1))[:, None]
    drawn = np.fft.rfft(rng.normal(size=(_DRAWS, *volumes.shape)), axis=1)
    noise = np.fft.irfft(drawn * sizes, n=len(volumes), axis=1)
    return np.asarray(noise / (noise.std() or 1.0), dtype=np.float64)


def _curves(
    volumes: Floats, phases: Floats, variances: Floats, rng: "np.random.Generator"
) -> tuple[Floats, Floats, Floats]:
    """Estimate volumes without noise: their mean given the data, and draws, (draws, ...).

    Amplitudes of harmonics are normal. Their covariance is what the data have beyond noise: for the
    rest of each segment the few directions in which segments vary by more than noise does (shrunk
    eigenvalues, as of a spiked covariance), and a power that is not larger in a higher harmonic.
    This power is estimated from as few segments as there are; further draws have powers that are
    drawn themselves: where noise hides it, it need not be zero.
    """
    n = min(len(phases) // 2, _HARMONICS)
    turns = 2.0 * np.pi * phases[:, None] * np.arange(1, n + 1)
    waves = np.sqrt(2.0) * np.concatenate([np.cos(turns), np.sin(turns)], axis=1)
    inverse = np.linalg.pinv(waves)
    alike, rest = _parts(volumes)
    whole = alike.sum(axis=1, keepdims=True)
    shares = whole.T @ alike / ((whole**2).sum() or 1.0)

    def tail(y: Floats, noise: Floats, known: Floats, chances: Floats | None = None) -> Floats:
        """Covariance of amplitudes that are independent, beyond noise and what is known."""
        squares = _by_harmonic(((inverse @ y) ** 2).mean(axis=1))
        known = _by_harmonic(inverse**2 @ noise.mean(axis=1) + known)
        if chances is not None:
            squares *= _ratios(chances, squares, known, len(volumes[0]) - 1)
        power = scipy.optimize.isotonic_regression(squares - known, increasing=False).x
        return np.diag(np.tile(np.maximum(power, 0.0), 2))

    def given(
        y: Floats, noise: Floats, covariance: Floats, n_draws: int = _DRAWS
    ) -> tuple[Floats, Floats]:
        values, directions = np.linalg.eigh(covariance)
        basis = waves @ (directions * np.sqrt(np.maximum(values, 0.0)))
        # An exact volume would have an infinite weight.
        weights = 1.0 / np.maximum(noise.T, _LEAST * (y**2).mean() or 1.0)[:, :, None]
        factors = np.linalg.cholesky(np.eye(2 * n) + basis.T @ (weights * basis))
        mean = np.linalg.solve(factors, basis.T @ (weights * y.T[:, :, None]))
        drawn = mean + rng.normal(size=(len(mean), 2 * n, n_draws))
        both = np.concatenate([mean, drawn], axis=2)
        curves = np.moveaxis(basis @ np.linalg.solve(factors.swapaxes(1, 2), both), 0, 2)
        return curves[:, 0], np.moveaxis(curves[:, 1:], 1, 0)

    of_whole = variances.sum(axis=1, keepdims=True)
    mean, drawn = given(whole, of_whole, tail(whole, of_whole, np.zeros(2 * n)))
    spikes = _spikes(inverse @ rest, np.sqrt(inverse**2 @ variances.mean(axis=1)))
    covariance = spikes + tail(rest, variances, np.diag(spikes))
    more, drawn_more = given(rest, variances, covariance)
    wider = []
    for chances in rng.uniform(size=(_POWERS, n)):
        covariance = spikes + tail(rest, variances, np.diag(spikes), chances)
        wider.append(given(rest, variances, covariance, _DRAWS // _POWERS)[1])
    alike = drawn * shares
    return mean * shares + more, alike + drawn_more, alike + np.concatenate(wider)


def _by_harmonic(of_waves: Floats) -> Floats:
    """Mean of the cosine and the sine of each harmonic."""
    return np.asarray(of_waves.reshape(2, -1).mean(axis=0), dtype=np.float64)


def _ratios(chances: Floats, squares: Floats, least: Floats, n: int) -> Floats:
    """Draw variances over the mean squares, of 2 n values, that show them; each at least `least`.

    The mean square over the variance is gamma-distributed; `chances` are uniform from 0 to 1.
    """
    tiny = np.finfo(np.float64).tiny
    most = n * squares / np.maximum(least, tiny)
    chances = np.maximum(chances * scipy.special.gammainc(n, most), tiny)
    return np.asarray(n / scipy.special.gammaincinv(n, chances), dtype=np.float64)


def _spikes(amplitudes: Floats, deviations: Floats) -> Floats:
    """Covariance of amplitudes, (amplitudes, segments), in directions beyond noise.

    Of eigenvalues above the largest that noise alone has; each counts by what of it is in the
    direction found (Donoho, Gavish, Johnstone, Ann Stat, 2018).
    """
    deviations = np.maximum(deviations, np.sqrt(_LEAST * (amplitudes**2).mean()) or 1.0)
    n = amplitudes.shape[1] - 1  # a sum of rests is zero
    ratio = len(amplitudes) / n
    found, directions = np.linalg.eigh(np.cov(amplitudes / deviations[:, None], bias=False))
    is_beyond = found > (1.0 + np.sqrt(ratio)) ** 2
    by = found[is_beyond] - 1.0 - ratio
    true = (by + np.sqrt(by**2 - 4.0 * ratio)) / 2.0
    true *= (1.0 - ratio / true**2) / (1.0 + ratio / true)
    directions = directions[:, is_beyond] * deviations[:, None]
    return np.asarray((directions * true) @ directions.T, dtype=np.float64)


def _parts(volumes: Floats) -> tuple[Floats, Floats]:
    """Motion of segments as if each followed the whole volume, and the rest of it."""
    moving = volumes - volumes.mean(axis=0)
    whole = moving.sum(axis=1)
    alike = np.outer(whole, whole @ moving / (whole @ whole or 1.0))
    return alike, moving - alike


def _apart(curves: Floats) -> float:
    """Spread of the instants at which curves are smallest, as a share of the cycle."""
    return float(_about_mean(curves.argmin(axis=0) / len(curves)).std(ddof=1))


def _about_mean(times: Floats) -> Floats:
    """Shares of a cycle from their mean direction: a cycle has no first instant."""
    mean = np.angle(np.exp(2j * np.pi * times).mean()) / (2 * np.pi)
    return np.asarray(np.mod(times - mean + 0.5, 1.0) - 0.5, dtype=np.float64)
