"""The resting shape: a truncated prolate spheroid, and three ways to measure along it.

A material point is a polar angle nu (rad, 0 at the apex) and an azimuth theta (rad).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

_N_TABLE: Final = 4001


class Spacing(StrEnum):
    """Quantity that is equal between the rows of a lattice."""

    ARC = "arc length"
    HEIGHT = "height"


@dataclass(frozen=True)
class Spheroid:
    """A prolate spheroid cut at its base.

    Parameters
    ----------
    length : float, mm
        From apex to base.
    radius : float, mm
        Of the widest section.
    truncation : float, rad
        Polar angle of the base.
    """

    length: float
    radius: float
    truncation: float

    def radius_at(self, nu: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance from the axis, mm."""
        r: NDArray[np.float64] = self.radius * np.sin(nu)
        return r

    def height_at(self, nu: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance from the apex along the axis, mm."""
        # 1 - cos nu = 2 sin^2(nu / 2), without cancellation at the apex.
        z: NDArray[np.float64] = 2.0 * self._semi_axis * np.sin(nu / 2) ** 2
        return z

    def slope_at(self, nu: NDArray[np.float64]) -> NDArray[np.float64]:
        """Height over polar angle, mm per rad."""
        slope: NDArray[np.float64] = self._semi_axis * np.sin(nu)
        return slope

    def speed_at(self, nu: NDArray[np.float64]) -> NDArray[np.float64]:
        """Arc length of the meridian over polar angle, mm per rad."""
        speed: NDArray[np.float64] = np.hypot(self.radius * np.cos(nu), self.slope_at(nu))
        return speed

    @property
    def area(self) -> float:
        """Area of the wall, mm^2."""
        ring = 2 * np.pi * self.radius_at(self._angles) * self.speed_at(self._angles)
        return float(_running_integral(ring, self._angles)[-1])

    def polar_angle(self, share: NDArray[np.float64], spacing: Spacing) -> NDArray[np.float64]:
        """Polar angle at a share (0 apex, 1 base) of the meridian's arc length or of the height."""
        if spacing == Spacing.HEIGHT:
            x = share * np.sin(self.truncation / 2) ** 2
            nu: NDArray[np.float64] = 2.0 * np.arcsin(np.sqrt(x))
            return nu
        return _interpolate(share, self._arc / self._arc[-1], self._angles)

    def polar_angle_of_area(self, share: NDArray[np.float64]) -> NDArray[np.float64]:
        """Polar angle below which a share of the area is."""
        # The area grows as nu^2 at the apex; its root interpolates well there.
        ring = self.radius_at(self._angles) * self.speed_at(self._angles)
        area = _running_integral(ring, self._angles)
        return _interpolate(np.sqrt(share), np.sqrt(area / area[-1]), self._angles)

    def isothermal_radius(self, nu: NDArray[np.float64]) -> NDArray[np.float64]:
        """Radius of the conformal map of the surface to the unit disc, 1 at the base."""
        # d ln rho / d nu = ds/dnu / r; its pole, 1/tan nu times the length at the apex, is
        # integrated in closed form.
        angles = self._angles
        rest = np.zeros_like(angles)
        rest[1:] = (self.speed_at(angles[1:]) / self.radius - 1.0) / np.sin(angles[1:])
        log_rho = _running_integral(rest, angles)
        log_rho = np.interp(nu, angles, log_rho) - log_rho[-1]
        rho: NDArray[np.float64] = (np.tan(nu / 2) / np.tan(self.truncation / 2)) * np.exp(log_rho)
        return rho

    @property
    def _semi_axis(self) -> float:
        return self.length / (1.0 - float(np.cos(self.truncation)))

    @cached_property
    def _angles(self) -> NDArray[np.float64]:
        return np.linspace(0.0, self.truncation, _N_TABLE)

    @cached_property
    def _arc(self) -> NDArray[np.float64]:
        return _running_integral(self.speed_at(self._angles), self._angles)


def directions(nu: NDArray[np.float64], theta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return unit vectors (..., 3): material points seen from the middle of a sphere.

    Any smooth function of them is a smooth function on the surface, at the apex too.
    """
    x, y = np.sin(nu) * np.cos(theta), np.sin(nu) * np.sin(theta)
    return np.stack([x, y, -np.cos(nu)], axis=-1)


def _running_integral(values: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.float64]:
    steps = (values[1:] + values[:-1]) / 2 * np.diff(at)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _interpolate(
    x: NDArray[np.float64], xs: NDArray[np.float64], ys: NDArray[np.float64]
) -> NDArray[np.float64]:
    y: NDArray[np.float64] = np.interp(x, xs, ys)
    return y
