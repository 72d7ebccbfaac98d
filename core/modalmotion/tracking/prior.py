"""The prior: how large an amplitude is before any data, from its wavenumber alone.

The strain energy of a mode is w^2 a^2 / 2 with w = c k, the continuum limit of (7), so its
Boltzmann distribution has the variance tau^2 / k^2. Nothing fixes that motion is excited alike in
all modes: the energy may decay as a power of the stiffness, variance tau^2 / k^2p. p = 1 is
the membrane's own, p = 2 the square of the stiffness, as of a bent plate. Scale and power are
those under which the data are the most likely. Beyond the last mode the same law goes on, which
gives the truncation: what the modes leave and how many independent values it has.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.representation import shown

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
    def broad(size: float) -> Prior:
        """Start for a surface of this size: motion of a twentieth of it in the longest waves."""
        return Prior(0.05 * size * (2.0 * np.pi) ** 2, 2.0, 0.5 * size)

    def variances(self, wavenumbers: NDArray[np.float64]) -> NDArray[np.float64]:
        """Variance of each mode in one direction, (modes,) float64, length unit squared."""
        k = np.where(wavenumbers > 0, wavenumbers, 1.0)
        still = wavenumbers <= 0
        variances: NDArray[np.float64] = np.where(
            still, self.drift**2, self.scale**2 * k ** (-2.0 * self.power)
        )
        return variances

    def beyond(self, wavenumbers: NDArray[np.float64], n_axes: int) -> tuple[float, float]:
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
    wavenumbers: NDArray[np.float64],
    energies: NDArray[np.float64],
    determined: NDArray[np.float64],
    least_drift: float,
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
