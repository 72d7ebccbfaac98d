"""Volume over time, each with a bound, and the figures derived from it."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from modalmotion.clinical.smooth_wall import smooth_walls
from modalmotion.errors import InputError
from modalmotion.mesh import Cavity, checks, geometry
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numeric.scales import power_of_two
from modalmotion.representation import Floats, shown
from modalmotion.template import Template

TWO_DEVIATIONS: Final = 2.0
"""Standard deviations of a 95 % interval, as for tracks."""


class Fraction(StrEnum):
    """Name of the relative difference of largest and smallest volume."""

    EJECTION_FRACTION = "ejection_fraction"
    VOLUME_CHANGE = "volume_change"

    @property
    def words(self) -> str:
        """The name in a sentence."""
        return self.value.replace("_", " ")


@shown("fraction", "share:%", "share_bound:%", "volumes")
@dataclass(frozen=True, eq=False)
class VolumeCurve:
    """Volume enclosed in each frame, and its error bound.

    Parameters
    ----------
    volumes : (frames,) float64, length unit cubed
        Positive as long as the surface does not turn inside out.
    bounds : (frames,) float64, length unit cubed
        Largest error from leaving out all other modes, and from rounding.
    fraction : Fraction or None
        Name of `share`: an ejection fraction if the surface is a cavity, otherwise a volume change.
        None for one frame, or if a volume is not positive.
    deviations : (frames,) float64, length unit cubed, optional
        Standard deviation of each volume by errors of the positions, if these are known.
    correlation : float
        Of these errors at end diastole and at end systole.
    """

    volumes: Floats
    bounds: Floats
    fraction: Fraction | None = None
    deviations: Floats | None = None
    correlation: float = 0.0

    @property
    def reach(self) -> Floats:
        """Largest error of each volume, (frames,): its bound and two deviations."""
        if self.deviations is None:
            return self.bounds
        return self.bounds + TWO_DEVIATIONS * self.deviations

    @property
    def end_diastole(self) -> int:
        """Frame of the largest volume, the first of them."""
        return int(np.argmax(self.volumes))

    @property
    def end_systole(self) -> int:
        """Frame of the smallest volume, the first of them."""
        return int(np.argmin(self.volumes))

    @property
    def end_diastolic_volume(self) -> float:
        """Largest volume, length unit cubed."""
        return float(self.volumes.max())

    @property
    def end_systolic_volume(self) -> float:
        """Smallest volume, length unit cubed."""
        return float(self.volumes.min())

    @property
    def stroke_volume(self) -> float:
        """Largest minus smallest volume, length unit cubed."""
        return self.end_diastolic_volume - self.end_systolic_volume

    @property
    def share(self) -> float | None:
        """Stroke volume over end-diastolic volume, percent; independent of the unit."""
        if self.fraction is None:
            return None
        return _lost(self.end_diastolic_volume, self.end_systolic_volume)

    @property
    def ejection_fraction(self) -> float | None:
        """The share, percent, if the surface is a cavity."""
        return self.share if self.fraction == Fraction.EJECTION_FRACTION else None

    @property
    def volume_change(self) -> float | None:
        """The share, percent, if it is not known that the surface is a cavity."""
        return self.share if self.fraction == Fraction.VOLUME_CHANGE else None

    @property
    def end_diastolic_range(self) -> tuple[float, float]:
        """Interval of the true end-diastolic volume, length unit cubed."""
        return _range(self.volumes, self.reach, np.max)

    @property
    def end_systolic_range(self) -> tuple[float, float]:
        """Interval of the true end-systolic volume, length unit cubed."""
        return _range(self.volumes, self.reach, np.min)

    @property
    def stroke_range(self) -> tuple[float, float]:
        """Interval of the true stroke volume, length unit cubed.

        Bounds add up; deviations of two frames add in squares, less what they have in common.
        """
        (low, high), (least, most) = self._within_bounds
        extra = TWO_DEVIATIONS * self._deviation_of_difference(1.0)
        return max(0.0, low - most - extra), high - least + extra

    @property
    def share_range(self) -> tuple[float, float] | None:
        """Interval of the true share, percent; from 0 to 100, as true volumes are positive.

        By bounds it falls with min V and rises with max V; each is in its interval, at any time. By
        deviations dF = (dV_ES - (1 - F) dV_ED) / V_ED.
        """
        share = self.share
        if share is None:
            return None
        (low, high), (least, most) = self._within_bounds
        off = self._deviation_of_difference(1.0 - share / 100.0) / self.end_diastolic_volume
        extra = 100.0 * TWO_DEVIATIONS * off
        return (
            max(0.0, _lost(low, most) - extra) if low > 0 else 0.0,
            min(100.0, _lost(high, least) + extra) if least > 0 else 100.0,
        )

    def figures(self, factor: float) -> dict[str, tuple[float, float, float]]:
        """Give the share, if it has a name, and the volumes times a factor, with their intervals.

        By name: ejection_fraction or volume_change, then end_diastolic_volume, end_systolic_volume
        and stroke_volume.
        """
        found: dict[str, tuple[float, float, float]] = {}
        if self.fraction is not None and (share := self.share_range) is not None:
            found[self.fraction.value] = (self.share or 0.0, *share)
        for name, value, (low, high) in (
            ("end_diastolic_volume", self.end_diastolic_volume, self.end_diastolic_range),
            ("end_systolic_volume", self.end_systolic_volume, self.end_systolic_range),
            ("stroke_volume", self.stroke_volume, self.stroke_range),
        ):
            found[name] = (factor * value, factor * low, factor * high)
        return found

    @property
    def _within_bounds(self) -> tuple[tuple[float, float], tuple[float, float]]:
        largest, smallest = (_range(self.volumes, self.bounds, end) for end in (np.max, np.min))
        return largest, smallest

    def _deviation_of_difference(self, factor: float) -> float:
        """Deviation of V_ES minus `factor` V_ED."""
        if self.deviations is None:
            return 0.0
        at_end = float(self.deviations[self.end_systole])
        at_start = factor * float(self.deviations[self.end_diastole])
        return checks.difference_deviation(at_end, at_start, self.correlation)

    @property
    def share_bound(self) -> float | None:
        """Largest error of the stated share, percentage points."""
        share, interval = self.share, self.share_range
        if share is None or interval is None:
            return None
        return max(interval[1] - share, share - interval[0])


def _range(
    volumes: Floats, reach: Floats, end: Callable[[Floats], np.float64]
) -> tuple[float, float]:
    return float(end(volumes - reach)), float(end(volumes + reach))


def _lost(largest: float, smallest: float) -> float:
    return 100.0 * (1.0 - smallest / largest)


def volume_deviations(sequence: MeshSequence, template: Template, cavity: Cavity) -> Floats | None:
    """Estimate the standard deviation of the volume in each frame.

    Parameters
    ----------
    sequence : MeshSequence
        A track has its own errors; otherwise noise is the residual from smooth functions.
    template : Template
    cavity : Cavity

    Returns
    -------
    (frames,) float64, length unit cubed, or None
        None for a surface without coordinates, too few vertices, or one frame.
    """
    if sequence.uncertainty is not None:
        return sequence.uncertainty.volumes
    if sequence.n_frames < 2:
        return None
    positions = sequence.vertices.astype(np.float64)
    positions -= positions[0].mean(axis=0)
    unit = power_of_two(float(np.abs(positions).max()) or 1.0)
    positions /= unit
    try:
        is_lattice = sequence.grid is not None
        wall, _ = smooth_walls(template, is_lattice=is_lattice)
    except InputError:
        return None
    # Roughness that is constant is shape, not noise.
    moves = positions - positions.mean(axis=0)
    variances = wall.noise(moves, wall.coefficients(moves))
    variances *= sequence.n_frames / (sequence.n_frames - 1)
    gradients = (geometry.volume_gradient(cavity, x) for x in positions)
    squares = np.array([float((gradient**2).sum()) for gradient in gradients])
    return np.asarray(unit**3 * np.sqrt(variances * squares), dtype=np.float64)
