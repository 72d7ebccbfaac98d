"""Kinematics: place of each material point of the ventricle at each time of the beat.

A prescribed motion, not mechanics: every wall element contracts towards the axis and along
the wall by its own share of its own time course, and each level turns about the axis. All
fields are smooth functions of the direction from the spheroid's middle, so the motion has no
kink at the apex.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.simulate.parameters import VentricleParameters
from modalmotion.simulate.spheroid import Spheroid, directions
from modalmotion.simulate.variation import SmoothField

# The fibrous ring at the base contracts half as much as the wall below it.
_BASE_RESTRAINT: Final = 0.5

# Width of a region's border, in the cosine of the angle from its centre.
_BORDER: Final = 0.12

# An akinetic wall keeps half of its shortening along the axis: its neighbours and the ring at
# the base pull it along.
_TETHERING: Final = 0.5

# Lateness of an individual's walls that move out of step, s.
_LAG: Final = 0.08

# Points along each meridian at which the wall's shortening is added up from the apex.
_QUADRATURE: Final = np.polynomial.legendre.leggauss(8)


@dataclass(frozen=True, eq=False)
class Moment:
    """One time of the beat, except for the radial contraction.

    Parameters
    ----------
    radii : (points,) float64, mm
        Of the resting wall.
    restraint : (points,) float64
        Share of the radial contraction that the fibrous ring permits.
    contraction : (points,) float64
    across : two of (points,) float64
        Cosine and sine of the azimuths.
    heights : (points,) float64, mm
    individual : (points, 3) float64, mm
        Added to the displacement.
    """

    radii: NDArray[np.float64]
    restraint: NDArray[np.float64]
    contraction: NDArray[np.float64]
    across: tuple[NDArray[np.float64], NDArray[np.float64]]
    heights: NDArray[np.float64]
    individual: NDArray[np.float64]

    def positions(self, radial: float) -> NDArray[np.float64]:
        """Positions in the body frame: origin at the resting apex, z from apex to base.

        Parameters
        ----------
        radial : float
            Radial contraction of a wall that contracts fully, as a share of its radius.

        Returns
        -------
        (points, 3) float64, mm
        """
        r = self.radii * (1.0 - radial * self.restraint * self.contraction)
        x = np.stack([r * self.across[0], r * self.across[1], self.heights], axis=1)
        x += self.individual
        return x


@dataclass(frozen=True, eq=False)
class MaterialPoints:
    """Material points of one ventricle and their motion.

    Parameters
    ----------
    parameters : VentricleParameters
    polar_angles, azimuths : (points,) float64, rad
    shape, displacement, lag : SmoothField
        Individual variation: added to the surface, to the displacement as it contracts, and to
        the displacement that runs ahead of or behind the contraction.
    """

    parameters: VentricleParameters
    polar_angles: NDArray[np.float64]
    azimuths: NDArray[np.float64]
    shape: SmoothField
    displacement: SmoothField
    lag: SmoothField

    def positions(self, time: float, radial: float) -> NDArray[np.float64]:
        """Positions at a time, (points, 3) float64, mm: see `at` and `Moment.positions`."""
        return self.at(time).positions(radial)

    def at(self, time: float) -> Moment:
        """Everything at a time that does not depend on the radial contraction.

        Parameters
        ----------
        time : float, s
            Since end diastole, 0 to one period.
        """
        p, beat = self.parameters, self.parameters.beat
        nu, theta, s = self.polar_angles, self.azimuths, self.spheroid
        q, q_below = self._contraction(time)
        # z(nu) = int_0^nu (1 - e q) dz/dnu dnu along the meridian, by Gauss's rule
        shortened = 1.0 - p.longitudinal_shortening * q_below
        z = (shortened * self._height_steps).sum(axis=0)
        rise = p.apex_share * p.longitudinal_shortening * p.length
        # Seen from the apex counterclockwise is clockwise about the axis: hence the minus.
        level = s.height_at(nu) / p.length
        turn = -np.radians(p.apex_rotation - level * p.twist) * beat.twist(time)
        in_time, late = beat.contraction(time, p.delay / 2 + np.array([0.0, _LAG]))
        shape, displacement, lag = self._individual
        return Moment(
            radii=s.radius_at(nu),
            restraint=self._restraint,
            contraction=q,
            across=(np.cos(theta + turn), np.sin(theta + turn)),
            heights=z + rise * beat.contraction(time, np.zeros(1)),
            individual=shape + in_time * displacement + (late - in_time) * lag,
        )

    @cached_property
    def spheroid(self) -> Spheroid:
        """The resting shape without individual variation."""
        p = self.parameters
        return Spheroid(p.length, p.radius, float(np.radians(p.truncation)))

    @cached_property
    def _individual(self) -> tuple[NDArray[np.float64], ...]:
        n = directions(self.polar_angles, self.azimuths)
        return self.shape.at(n), self.displacement.at(n), self.lag.at(n)

    @cached_property
    def _restraint(self) -> NDArray[np.float64]:
        level = self.spheroid.height_at(self.polar_angles) / self.parameters.length
        restraint: NDArray[np.float64] = 1.0 - _BASE_RESTRAINT * level**4
        return restraint

    @cached_property
    def _height_steps(self) -> NDArray[np.float64]:
        """Height of the resting wall in each part of the quadrature, (nodes, points), mm."""
        share, weight = (_QUADRATURE[0] + 1) / 2, _QUADRATURE[1] / 2
        steps: NDArray[np.float64] = (
            weight[:, None]
            * self.polar_angles
            * self.spheroid.slope_at(share[:, None] * self.polar_angles)
        )
        return steps

    @cached_property
    def _regions(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Working share, lateness and earliness of the points (row 0) and of those below them."""
        share = np.concatenate([[1.0], (_QUADRATURE[0] + 1) / 2])
        n = directions(share[:, None] * self.polar_angles, self.azimuths)
        p = self.parameters
        # The wall between the late (1) and the early side (0), and how septal it is.
        late = (1.0 + n[..., :2] @ _across(p.delay_azimuth)) / 2
        lost = p.akinesia * region_weight(p, n)
        lost[1:] *= 1.0 - _TETHERING
        return 1.0 - lost, late, (1.0 - late) ** 2

    def _contraction(self, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Contraction at the points, and at the quadrature's nodes below each of them."""
        p, beat = self.parameters, self.parameters.beat
        working, late, early = self._regions
        flash = p.septal_flash * early
        q = beat.contraction(time, p.delay * late)
        q = working * ((1.0 - flash) * q + flash * beat.flash(time))
        return q[0], q[1:]


def region_weight(parameters: VentricleParameters, n: NDArray[np.float64]) -> NDArray[np.float64]:
    """Membership of a wall element in the akinetic region, 1 at its centre.

    Parameters
    ----------
    parameters : VentricleParameters
    n : (..., 3) float64
        Directions of the elements.

    Returns
    -------
    (...) float64
    """
    p = parameters
    x, y = np.sin(_polar_angle(p)) * _across(p.akinesia_azimuth)
    centre = np.array([x, y, -np.cos(_polar_angle(p))])
    edge = np.cos(np.radians(p.akinesia_extent))
    inside = 1.0 / (1.0 + np.exp(-(n @ centre - edge) / _BORDER))
    weight: NDArray[np.float64] = inside * (1.0 + np.exp(-(1.0 - edge) / _BORDER))
    return weight


def _polar_angle(parameters: VentricleParameters) -> float:
    x = parameters.akinesia_height * np.sin(np.radians(parameters.truncation) / 2) ** 2
    return float(2.0 * np.arcsin(np.sqrt(x)))


def _across(azimuth: float) -> NDArray[np.float64]:
    angle = np.radians(azimuth)
    return np.array([np.cos(angle), np.sin(angle)])
