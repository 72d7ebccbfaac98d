"""Parameters of a simulated left ventricle, its time courses, and differences between hearts.

Each time course is 0 at end diastole (t = 0) and again a period later.
"""

from dataclasses import dataclass, field, fields
from enum import StrEnum
from typing import Any, Final

import numpy as np

from modalmotion.arguments.checking import real
from modalmotion.errors import ParameterError
from modalmotion.representation import Floats, shown

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

    def contraction(self, time: float, delay: Floats) -> Floats:
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


def _ramp(time: Floats, start: float, end: float) -> Floats:
    """Rise from 0 to 1 with two continuous derivatives."""
    x = np.minimum(np.maximum((time - start) / (end - start), 0.0), 1.0)
    risen: Floats = x - np.sin(2 * np.pi * x) / (2 * np.pi)
    return risen


class Territory(StrEnum):
    """Wall that one coronary artery usually supplies.

    After Cerqueira et al., Standardized myocardial segmentation and nomenclature for
    tomographic imaging of the heart, Circulation, 2002 (17 segments).
    """

    LAD = "left anterior descending"
    RCA = "right coronary"
    LCX = "left circumflex"


# Azimuth (see VentricleParameters) and height of the middle of each territory: LAD segments
# 1, 2, 7, 8, 13, 14, 17, RCA 3, 4, 9, 10, 15, LCX 5, 6, 11, 12, 16.
TERRITORY_CENTRES: Final[dict[Territory, tuple[float, float]]] = {
    Territory.LAD: (240.0, 0.30),
    Territory.RCA: (120.0, 0.55),
    Territory.LCX: (0.0, 0.55),
}


def between(default: float, low: float, high: float) -> Any:
    """Make the field of a number from `low` to `high`."""
    return field(default=default, metadata={"range": (low, high)})


def require_ranges(settings: Any, what: str) -> None:
    """Check the fields that have a range.

    Raises
    ------
    ParameterError
        Naming the parameter and its range.
    """
    for parameter in (one for one in fields(settings) if "range" in one.metadata):
        value = real(parameter.name, getattr(settings, parameter.name))
        low, high = parameter.metadata["range"]
        if not low <= value <= high:
            raise ParameterError(
                f"The {what}'s {parameter.name} is {value}.",
                remedy=f"Use a value from {low} to {high}.",
                details={"parameter": parameter.name, "least": low, "most": high},
            )


@shown("ejection_fraction", "length", "radius", "period", "akinesia", "delay", "septal_flash")
@dataclass(frozen=True)
class VentricleParameters:
    """One ventricle and its beat. The defaults are a healthy adult's.

    Azimuths are right-handed about the axis from apex to base, in degrees: 0 lateral,
    90 inferior, 180 septal, 270 anterior. Rotations are as seen from the apex,
    counterclockwise positive, as in cardiology: the opposite sense about that axis.

    Parameters
    ----------
    length : float, mm
        Length of the cavity from apex to base at end diastole.
    radius : float, mm
        Radius of the widest short-axis section at end diastole.
    truncation : float, degrees
        Polar angle at which the spheroid is cut for the base; 90 cuts at its widest.
    ejection_fraction : float
        Share of the end-diastolic volume that is ejected. The radial contraction is solved
        for it.
    longitudinal_shortening : float
        Shortening of the wall along the axis at end systole, as a share, where it contracts
        fully.
    apex_share : float
        Share of that shortening which shows as the apex rising, not the base descending.
    apex_rotation, base_rotation : float, degrees
        Rotation at end systole, counterclockwise seen from the apex. Linear in height between.
    period : float, s
        Duration of one heartbeat.
    early_filling : float
        Share of the filling before the atrial kick.
    akinesia : float
        Share of the contraction that is lost at the centre of a region: 1 for akinetic, above
        for dyskinetic.
    akinesia_azimuth : float, degrees
        Azimuth of the region's centre, 0 lateral, 90 inferior, 180 septal, 270 anterior.
    akinesia_height : float
        Height of the region's centre, 0 apex to 1 base.
    akinesia_extent : float, degrees
        Angle from the region's centre to its edge, seen from the middle of the spheroid.
    delay : float, s
        Delay of the late wall's contraction behind the opposite wall's.
    delay_azimuth : float, degrees
        Azimuth of the late wall; 0 (lateral) in left bundle branch block.
    septal_flash : float
        Short early contraction of the early wall, as a share of a full one, which it then
        lacks in ejection.
    shape_variation, motion_variation : float, mm
        RMS of smooth random fields that make one individual, added to the surface or to the
        displacements at end systole.

    Raises
    ------
    ParameterError
        Naming the parameter and its range.

    Notes
    -----
    Ejection fraction 52-72 % in men and 54-74 % in women, and an end-diastolic diameter of
    42-58 and 38-52 mm: Lang et al., Recommendations for cardiac chamber quantification, J Am
    Soc Echocardiogr, 2015. Longitudinal strain -20.1 %: Wang et al., Thresholds for abnormal
    left ventricular strains in healthy subjects, Cardiovasc Diagn Ther, 2020 (here of the
    endocardium, which shortens more than the midwall). Apex about 10 degrees
    counterclockwise, base about 3 clockwise: Young and Cowan, Evaluation of left ventricular
    torsion by cardiovascular magnetic resonance, J Cardiovasc Magn Reson, 2012. A truncated
    prolate spheroid: Streeter and Hanna, Engineering mechanics for successive states in
    canine left ventricular myocardium, Circ Res, 1973.
    """

    length: float = between(88.0, 20.0, 200.0)
    radius: float = between(25.0, 5.0, 80.0)
    truncation: float = between(118.0, 80.0, 150.0)
    ejection_fraction: float = between(0.62, 0.0, 0.85)
    longitudinal_shortening: float = between(0.19, 0.0, 0.35)
    apex_share: float = between(0.3, 0.0, 1.0)
    apex_rotation: float = between(10.0, -30.0, 40.0)
    base_rotation: float = between(-4.0, -40.0, 30.0)
    period: float = between(0.86, 0.45, 2.0)
    early_filling: float = between(0.78, 0.2, 1.0)
    akinesia: float = between(0.0, 0.0, 1.5)
    akinesia_azimuth: float = between(240.0, -360.0, 360.0)
    akinesia_height: float = between(0.3, 0.0, 1.0)
    akinesia_extent: float = between(45.0, 10.0, 90.0)
    delay: float = between(0.0, 0.0, 0.25)
    delay_azimuth: float = between(0.0, -360.0, 360.0)
    septal_flash: float = between(0.0, 0.0, 0.8)
    shape_variation: float = between(0.0, 0.0, 10.0)
    motion_variation: float = between(0.0, 0.0, 10.0)

    def __post_init__(self) -> None:
        require_ranges(self, "ventricle")
        if self.beat.filled + self.delay > self.period:
            raise ParameterError(
                f"A wall that is {self.delay} s late is not filled when the next beat comes "
                f"after {self.period} s.",
                remedy="Use a shorter delay or a longer period.",
                details={"parameter": "delay", "most": self.period - self.beat.filled},
            )

    @property
    def beat(self) -> Beat:
        """Time courses of this heartbeat."""
        return Beat(self.period, self.early_filling)

    @property
    def twist(self) -> float:
        """Rotation of the apex against the base at end systole, degrees."""
        return self.apex_rotation - self.base_rotation


_N_WAVES: Final = 32


@dataclass(frozen=True, eq=False)
class SmoothField:
    """A random vector field on the unit sphere, close to a Gaussian process.

    A sum of random cosines (Rahimi and Recht, Random features for large-scale kernel
    machines, NIPS, 2007), so it has all derivatives everywhere, the apex included.

    Parameters
    ----------
    wave_vectors : (waves, 3) float64
    phases : (waves,) float64, rad
    strengths : (waves, 3) float64, mm
    """

    wave_vectors: Floats
    phases: Floats
    strengths: Floats

    def at(self, directions: Floats) -> Floats:
        """Field vectors, (..., 3) float64, mm, at unit vectors (..., 3)."""
        values: Floats = np.cos(directions @ self.wave_vectors.T + self.phases) @ self.strengths
        return values


def random_field(rms: float, length: float, rng: "np.random.Generator") -> SmoothField:
    """Draw a field.

    Parameters
    ----------
    rms : float, mm
        Expected RMS length of its vectors.
    length : float
        Distance on the unit sphere over which the field forgets itself.
    rng : numpy.random.Generator
    """
    wave_vectors = rng.standard_normal((_N_WAVES, 3)) / length
    phases = rng.uniform(0.0, 2 * np.pi, _N_WAVES)
    strengths = rng.standard_normal((_N_WAVES, 3)) * rms * np.sqrt(2.0 / (3 * _N_WAVES))
    return SmoothField(wave_vectors, phases, strengths)
