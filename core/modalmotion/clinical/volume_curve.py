"""Volume over time, each with a bound, and the figures derived from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.representation import shown


@shown("ejection_fraction", "ejection_fraction_bound", "volumes")
@dataclass(frozen=True, eq=False)
class VolumeCurve:
    """Volume enclosed in each frame, and its error bound.

    Parameters
    ----------
    volumes : (frames,) float64, length unit cubed
        Positive as long as the surface does not turn inside out.
    bounds : (frames,) float64, length unit cubed
        The true volume lies within volume - bound and volume + bound.
    """

    volumes: NDArray[np.float64]
    bounds: NDArray[np.float64]

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
        """Largest volume less the smallest, length unit cubed."""
        return self.end_diastolic_volume - self.end_systolic_volume

    @property
    def ejection_fraction(self) -> float:
        """Stroke volume over end-diastolic volume, percent; independent of the unit."""
        return _ejected(self.end_diastolic_volume, self.end_systolic_volume)

    @property
    def end_diastolic_range(self) -> tuple[float, float]:
        """Interval of the true end-diastolic volume, length unit cubed."""
        return float((self.volumes - self.bounds).max()), float((self.volumes + self.bounds).max())

    @property
    def end_systolic_range(self) -> tuple[float, float]:
        """Interval of the true end-systolic volume, length unit cubed."""
        return float((self.volumes - self.bounds).min()), float((self.volumes + self.bounds).min())

    @property
    def stroke_range(self) -> tuple[float, float]:
        """Interval of the true stroke volume, length unit cubed."""
        (low, high), (least, most) = self.end_diastolic_range, self.end_systolic_range
        return max(0.0, low - most), high - least

    @property
    def ejection_fraction_range(self) -> tuple[float, float]:
        """Interval of the true ejection fraction, percent.

        Falls with min V and rises with max V; each lies in its interval, wherever in time.
        """
        (low, high), (least, most) = self.end_diastolic_range, self.end_systolic_range
        if low <= 0:
            # Not even the sign of the larger volume is known.
            return 0.0, float("inf")
        # 1 - min V / max V grows with max V where min V is positive, else it falls.
        return max(0.0, _ejected(low if most > 0 else high, most)), _ejected(
            high if least > 0 else low, least
        )

    @property
    def ejection_fraction_bound(self) -> float:
        """Largest error of the stated ejection fraction, percentage points."""
        low, high = self.ejection_fraction_range
        return max(high - self.ejection_fraction, self.ejection_fraction - low)


def _ejected(largest: float, smallest: float) -> float:
    return 100.0 * (1.0 - smallest / largest) if largest > 0 else 0.0
