"""The prior, and what separates data from the surface in its modes: noise, truncation, strays.

The strain energy of a mode is w^2 a^2 / 2 with w = c k, the continuum limit of (7), so its
Boltzmann distribution has the variance tau^2 / k^2. Nothing fixes that motion is excited alike in
all modes: the energy may decay as a power of the stiffness, variance tau^2 / k^2p. p = 1 is
the membrane's own, p = 2 the square of the stiffness, as of a bent plate. Scale and power are
those under which the data are the most likely. Beyond the last mode the same law goes on, which
gives the truncation: what the modes leave and how many independent values it has.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import scipy

from modalmotion.representation import Floats, shown

# Powers that are tried. Below 1 the energy beyond the modes would not end.
_POWERS: Final = np.arange(1.25, 3.01, 0.05)


@shown()
@dataclass(frozen=True)
class Prior:
    """Variances of amplitudes before any data.

    Parameters
    ----------
    scale : float, length unit
        tau: standard deviation that the law gives a mode of wavenumber 1.
    power : float
        p of the variance tau^2 / k^2p.
    drift : float, length unit
        Standard deviation of mode 0, the mean translation.
    """

    scale: float
    power: float
    drift: float

    @staticmethod
    def broad(size: float) -> "Prior":
        """Start for a surface of this size: motion of a twentieth of it in the longest waves."""
        return Prior(0.05 * size * (2.0 * np.pi) ** 2, 2.0, 0.5 * size)

    def variances(self, wavenumbers: Floats) -> Floats:
        """Variance of each mode in one direction, (modes,) float64, length unit squared."""
        k = np.where(wavenumbers > 0, wavenumbers, 1.0)
        still = wavenumbers <= 0
        variances: Floats = np.where(still, self.drift**2, self.scale**2 * k ** (-2.0 * self.power))
        return variances

    def beyond(self, wavenumbers: Floats, n_axes: int) -> tuple[float, float]:
        """Mean square of one component of what the modes leave, and its independent values.

        Parameters
        ----------
        wavenumbers : (modes,) float64
        n_axes : int
            Of the lattice: 2 of a surface, 1 of a curve.

        Returns
        -------
        float, float
            Length unit squared, and a number.

        Notes
        -----
        On a surface the number of modes up to k grows as k^2, on a curve as k; with j the rank,
        variances fall as j^-q, q = 2p / axes. Then sum_{j > m} v_j = v_m m / (q - 1), and the
        number of equal variances with the same sum and sum of squares is
        (sum v)^2 / sum v^2 = m (2q - 1) / (q - 1)^2.
        """
        m = len(wavenumbers)
        last = float(self.variances(wavenumbers[-1:])[0])
        q = 2.0 * self.power / n_axes
        return last * m / (q - 1.0), m * (2.0 * q - 1.0) / (q - 1.0) ** 2

    def concentration(self, n_axes: int) -> float:
        """Independent values beyond the modes, over those if all were as large as the first.

        m (2q - 1) / (q - 1)^2 over sum v / v_m = m / (q - 1).
        """
        q = 2.0 * self.power / n_axes
        return (2.0 * q - 1.0) / (q - 1.0)


def most_likely_prior(
    wavenumbers: Floats, energies: Floats, determined: Floats, least_drift: float
) -> Prior:
    """Scale and power under which the amplitudes are the most likely.

    Parameters
    ----------
    wavenumbers : (modes,) float64
    energies : (modes,) float64, length unit squared
        Sum of squared amplitudes over frames and directions.
    determined : (modes,) float64
        Sum of the determined shares 1 - posterior / prior variance over the same: how many
        amplitudes the data, and not the prior, have set (MacKay, Bayesian interpolation,
        Neural Computation 4, 1992).
    least_drift : float, length unit
    """
    moves = wavenumbers > 0
    k, e, g = wavenumbers[moves], energies[moves], np.maximum(determined[moves], 1e-12)
    # -2 log of the likelihood, scale put in: sum g log v + e / v, v = tau^2 k^-2p.
    scales = np.array([(e * k ** (2.0 * p)).sum() / g.sum() for p in _POWERS])
    with np.errstate(divide="ignore"):
        unlikely = g.sum() * np.log(scales) - 2.0 * _POWERS * (g * np.log(k)).sum()
    best = int(np.argmin(unlikely))
    still = ~moves
    drift = np.sqrt(energies[still].sum() / max(float(determined[still].sum()), 1e-12))
    return Prior(
        scale=max(float(np.sqrt(scales[best])), least_drift),
        power=float(_POWERS[best]),
        drift=max(float(drift), least_drift),
    )


# Tukey's biweight with 95 % efficiency on Gaussian residuals.
_TUKEY: Final = 4.685

# Share of Gaussian errors within one standard deviation, and the size that as large a share of
# errors across a surface, and across a curve in two directions, stays below.
_WITHIN: Final = 0.6827
_SIZE_WITHIN: Final = {2: 1.0, 1: 1.5152}

# Standard deviation of Gaussian residuals over their median size.
_PER_MEDIAN: Final = 1.4826

# Of the whole residual: clean data would let the noise vanish, and weights with it.
_LEAST_SHARE: Final = 0.05


@shown()
@dataclass(frozen=True)
class Noise:
    """Spread of residuals.

    Residuals are not white. What the modes leave is smooth: as many points as one likes see
    only a limited number of independent values of it, so that the variance of a mean does not
    fall below truncation^2 / n_values.

    Parameters
    ----------
    sd : float, length unit
        Of one point, independent of all others.
    truncation : float, length unit
        What the modes leave, along the normal.
    n_values : float
        Independent values of it on the whole surface.
    """

    sd: float
    truncation: float
    n_values: float

    @property
    def total(self) -> float:
        """RMS distance of a point from the surface in its modes, length unit."""
        return float(np.hypot(self.sd, self.truncation))

    def own(self, sd: Floats | float | None) -> Floats | float:
        """Variance of each point's own noise, length unit squared; of all where it is unknown."""
        variance: Floats | float = np.square(self.sd if sd is None else sd)
        return variance

    def variances(self, sd: Floats | float | None, n_points: float) -> Floats | float:
        """Variance that each of so many points counts with, length unit squared.

        Parameters
        ----------
        sd : float or (n,) float64, length unit, or None
            Its own standard deviation where it is known.
        n_points : float
            Points in the frame.

        Notes
        -----
        var(mean) = sd^2 / n + truncation^2 / n_values, so each of n counts with n times that.
        """
        share = max(1.0, n_points / self.n_values)
        total: Floats | float = self.own(sd) + self.truncation**2 * share
        return total


class Residuals(NamedTuple):
    """What the fit of one frame leaves.

    Parameters
    ----------
    points, residuals : (n, 3) float64, length unit
    weights : (n,) float64
    n_spent : float
        Amplitudes that the data have set.
    energy : float
        Mean over the modes of a^2 over its prior variance.
    """

    points: Floats
    residuals: Floats
    weights: Floats
    n_spent: float
    energy: float


def noise_of(
    frames: Sequence[Residuals], n_values: float, n_axes: int, *, is_exact: bool
) -> tuple[Noise, Floats]:
    """Noise under which the residuals are as large, and as much alike, as they are.

    Noise of a point says nothing of that of its neighbour; what the modes leave is nearly the
    same at both, and has no part in their difference. Where the surface has hardly moved hardly
    anything is left: truncation^2 grows with the energy of a frame, and is fitted to it. What is
    left is large in few places and small in most, so sizes are those that 68 % stay below, as an
    interval of one standard deviation says, and not root mean squares.

    Parameters
    ----------
    frames : sequence of Residuals
    n_values : float
        Independent values of the truncation.
    n_axes : int
        2 of a surface, 1 of a curve.
    is_exact : bool
        Whether the shape at rest is that of a frame, so that nothing is left where nothing moves.

    Returns
    -------
    Noise
        Of all frames alike: estimated with what grows with the motion, a frame would be drawn to
        the start the more the farther it moves.
    (frames,) float64, length unit
        Truncation of each, for stated deviations alone.
    """
    sizes = [_sizes(frame) for frame in frames]
    weights, totals, own = np.array(sizes).reshape(-1, 3).T
    totals, own = totals / _SIZE_WITHIN[n_axes] ** 2, own / _SIZE_WITHIN[n_axes] ** 2
    n = max(float(weights.sum()), 1e-300)
    # The fit takes a part of each residual.
    spent = np.array([frame.n_spent for frame in frames])
    totals = totals * weights / np.maximum(weights - spent, np.maximum(0.25 * weights, 1e-300))
    mean = float((weights * totals).sum()) / n
    variance = max(min(float((weights * own).sum()) / n, mean), _LEAST_SHARE**2 * mean)
    # truncation^2 = c + alpha e, none below zero, weighted by points.
    rises = np.array([(0.0 if is_exact else 1.0, frame.energy) for frame in frames])
    root, unit = np.sqrt(weights / n), mean if mean > 0 else 1.0
    left = np.maximum(totals - variance, 0.0) / unit
    squares = unit * (rises @ scipy.optimize.nnls(rises * root[:, None], left * root)[0])
    noise = Noise(float(np.sqrt(variance)), float(np.sqrt(squares.mean())), n_values)
    return noise, np.sqrt(squares)


def _sizes(frame: Residuals) -> tuple[float, float, float]:
    """Sum of weights, square of the size of residuals and of half the differences of neighbours."""
    kept = frame.weights > 0
    total = float(frame.weights.sum())
    if kept.sum() < 2:
        return total, 0.0, 0.0
    r = frame.residuals[kept]
    # Neighbours on the surface: those in space have noise alike.
    feet = frame.points[kept] - r
    other = scipy.spatial.cKDTree(feet).query(feet, k=2)[1][:, 1]
    size = float(np.quantile(np.linalg.norm(r, axis=1), _WITHIN))
    apart = float(np.quantile(np.linalg.norm(r - r[other], axis=1), _WITHIN))
    return total, size**2, apart**2 / 2.0


def robust_weights(residuals: Floats, total: float) -> Floats:
    """Tukey's biweights (1 - (r/cs)^2)^2, zero beyond c s.

    Parameters
    ----------
    residuals : (n,) float64, length unit
    total : float, length unit
        Residuals of this size are expected, and never strays.
    """
    if not len(residuals):
        return residuals
    spread = max(total, _PER_MEDIAN * float(np.median(np.abs(residuals))), 1e-300)
    u = np.minimum(np.abs(residuals) / (_TUKEY * spread), 1.0)
    weights: Floats = (1.0 - u * u) ** 2
    return weights
