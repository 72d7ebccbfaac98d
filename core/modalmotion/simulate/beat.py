"""Time courses of one heartbeat: contraction, twist and septal flash.

Each is 0 at end diastole (t = 0) and again a period later.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

# Isovolumic contraction, s: mitral closure to aortic opening.
_ISOVOLUMIC_CONTRACTION: Final = 0.05

# Ends of isovolumic relaxation and of early filling, and the start of the atrial kick, as
# shares of the time from end systole to the next beat.
_RELAXATION_ENDS: Final = 0.15
_EARLY_FILLING_ENDS: Final = 0.55
_ATRIAL_KICK_STARTS: Final = 0.75

# The twist is gone after this share of diastole, which puts 36 % of the untwisting into
# isovolumic relaxation (Cheng-Baron et al., Am J Physiol Heart Circ Physiol, 2010: 37 +- 18 %).
_UNTWISTED: Final = 0.35

# Septal flash, s: a short inward motion of the septum around aortic opening.
_FLASH_STARTS: Final = 0.01
_FLASH_LASTS: Final = 0.12


@dataclass(frozen=True)
class Beat:
    """Times of the phases of one heartbeat.

    Parameters
    ----------
    period : float, s
    early_filling : float
        Share of the filling before the atrial kick.

    Notes
    -----
    Ejection lasts 413 ms - 1.7 ms per beat per minute (Weissler, Harris and Schoenfeld,
    Systolic time intervals in heart failure in man, Circulation, 1968).
    """

    period: float
    early_filling: float

    @property
    def end_systole(self) -> float:
        """End of ejection, s; the volume is constant until `relaxed`."""
        return _ISOVOLUMIC_CONTRACTION + 0.413 - 0.0017 * 60.0 / self.period

    @property
    def relaxed(self) -> float:
        """End of isovolumic relaxation, s."""
        return self._in_diastole(_RELAXATION_ENDS)

    @property
    def filled(self) -> float:
        """End of early filling, s, without delay."""
        return self._in_diastole(_EARLY_FILLING_ENDS)

    def contraction(self, time: float, delay: NDArray[np.float64]) -> NDArray[np.float64]:
        """Share of the full contraction, 0 to 1.

        Parameters
        ----------
        time : float, s
            Since end diastole, 0 to one period.
        delay : (...) float64, s
            Delay of ejection and early filling; the atrial kick is not delayed.

        Returns
        -------
        (...) float64
        """
        late = time - delay
        ejected = _ramp(late, _ISOVOLUMIC_CONTRACTION, self.end_systole)
        filled = _ramp(late, self.relaxed, self.filled)
        kick = _ramp(np.asarray(time), self._in_diastole(_ATRIAL_KICK_STARTS), self.period)
        return ejected - self.early_filling * filled - (1.0 - self.early_filling) * kick

    def twist(self, time: float) -> float:
        """Share of the full twist, 0 to 1."""
        twisted = _ramp(np.asarray(time), 0.0, self.end_systole)
        untwisted = _ramp(np.asarray(time), self.end_systole, self._in_diastole(_UNTWISTED))
        return float(twisted - untwisted)

    def flash(self, time: float) -> float:
        """Share of the full septal flash, 0 to 1."""
        x = (time - _FLASH_STARTS) / _FLASH_LASTS
        return float(np.sin(np.pi * x) ** 2) if 0.0 < x < 1.0 else 0.0

    def _in_diastole(self, share: float) -> float:
        return self.end_systole + share * (self.period - self.end_systole)


def _ramp(time: NDArray[np.float64], start: float, end: float) -> NDArray[np.float64]:
    """Rise from 0 to 1 with two continuous derivatives."""
    x = np.minimum(np.maximum((time - start) / (end - start), 0.0), 1.0)
    risen: NDArray[np.float64] = x - np.sin(2 * np.pi * x) / (2 * np.pi)
    return risen
