"""Peak rates of ejection and filling, heart rate and cardiac output."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from modalmotion.clinical.readouts import ClinicalReadouts
from modalmotion.errors import ParameterError
from modalmotion.representation import Floats, shown

# Points between two frames at which a spline's slope is evaluated.
_FINE: Final = 32

# A spline's peak is off by so many times its distance from the chords' at most, and by so many
# times the square of that as a share of it: chords are off by O(h^2), splines by O(h^3) at most.
_FAR: Final = 1.5
_NEAR: Final = 6.0


@shown("heart_rate", "cardiac_output", "peak_ejection_rate", "peak_filling_rate")
@dataclass(frozen=True)
class Rates:
    """Rates of a beating cavity; volumes in the read-outs' `volume_unit`.

    Parameters
    ----------
    peak_ejection_rate, peak_filling_rate : float, volume per s
        Largest fall and rise of the volume, of a cubic spline through the frames; both positive.
    ejection_bound, filling_bound : float, volume per s
        Bounds on the error of the rates: from the volumes' own bounds, and between frames.
    ejection_frame, filling_frame : int
        Frames nearest to the peaks.
    heart_rate : float or None, beats per minute
        None if no period is given.
    cardiac_output : float or None, volume per minute
        Stroke volume times heart rate.
    output_range : tuple of float or None, volume per minute
        Interval of the true cardiac output.
    """

    peak_ejection_rate: float
    peak_filling_rate: float
    ejection_bound: float
    filling_bound: float
    ejection_frame: int
    filling_frame: int
    heart_rate: float | None
    cardiac_output: float | None
    output_range: tuple[float, float] | None


def rates_of(readouts: ClinicalReadouts, period: float | None = None) -> Rates:
    """Derive rates from a volume over time.

    Parameters
    ----------
    readouts : ClinicalReadouts
    period : float, s, optional
        Of the heartbeat. The frame after the last is then the first, unless it repeats it.

    Raises
    ------
    ParameterError
        If the times are unknown, or there are fewer than three frames.
    """
    times, factor = readouts.times, readouts.shown_in
    if times is None or len(times) < 3:
        raise ParameterError(
            "Rates of emptying and filling need the times of at least three frames.",
            remedy="Give the times or the interval of the frames (--frame-interval).",
        )
    volumes, bounds = readouts.curve.volumes * factor, readouts.curve.bounds * factor
    fall, rise = _peaks(times, volumes, bounds, period)
    heart_rate = output = interval = None
    if period is not None:
        heart_rate = 60.0 / period
        output = readouts.curve.stroke_volume * factor * heart_rate
        low, high = readouts.curve.stroke_range
        interval = (low * factor * heart_rate, high * factor * heart_rate)
    return Rates(
        peak_ejection_rate=fall.rate,
        peak_filling_rate=rise.rate,
        ejection_bound=fall.bound,
        filling_bound=rise.bound,
        ejection_frame=fall.frame,
        filling_frame=rise.frame,
        heart_rate=heart_rate,
        cardiac_output=output,
        output_range=interval,
    )


@dataclass(frozen=True)
class _Peak:
    """Largest rate of one sign, its bound and the frame next to it."""

    rate: float
    bound: float
    frame: int


def _peaks(
    times: Floats, volumes: Floats, bounds: Floats, period: float | None
) -> tuple[_Peak, _Peak]:
    """Largest fall and rise, periodic if the cycle is closed."""
    n = len(times)
    t, step = times, float(times[-1] - times[0]) / (n - 1)
    weights = np.eye(n)
    closes = period is not None and period > t[-1] - t[0] - 0.5 * step
    if closes and period is not None:
        if period < t[-1] - t[0] + 0.5 * step:
            # The last frame repeats the first: one volume, measured twice.
            t, weights = t[:-1], weights[:-1]
            weights[0, -1] = weights[0, 0] = 0.5
        t = np.append(t, t[0] + period)
        weights = np.concatenate([weights, weights[:1]])
    # Rates are sums of volumes: (times, frames) weights.
    spline = scipy.interpolate.CubicSpline(t, weights, bc_type="periodic" if closes else "natural")
    fine = np.interp(np.arange(_FINE * (len(t) - 1) + 1) / _FINE, np.arange(len(t)), t)
    slopes = spline(fine, 1)
    # The slope at an open end depends on the end condition.
    knots = scipy.interpolate.CubicSpline(t, weights, bc_type="not-a-knot")
    other = slopes if closes else knots(fine, 1)
    rates, others = slopes @ volumes, other @ volumes
    chords = _central(t, weights @ volumes, is_closed=closes)
    found = []
    for sign in (-1.0, 1.0):
        at = int(np.argmax(sign * rates))
        rate = max(0.0, float(sign * rates[at]))
        beside = abs(rate - max(0.0, float((sign * chords).max())))
        between = beside * min(_FAR, _NEAR * beside / rate) if rate > 0.0 else 0.0
        between += abs(float((sign * others).max()) - float((sign * rates).max()))
        frame = int(np.argmin(np.abs(t - fine[at])))
        found.append(
            _Peak(
                rate,
                float(np.abs(slopes[at]) @ bounds) + between,
                0 if closes and frame == len(t) - 1 else frame,
            )
        )
    return found[0], found[1]


def _central(t: Floats, v: Floats, *, is_closed: bool) -> Floats:
    """Slopes of chords between the neighbours of each time; at open ends from one side."""
    if is_closed:
        t = np.concatenate([[t[0] - (t[-1] - t[-2])], t])
        v = np.concatenate([v[-2:-1], v])
    else:
        t, v = (np.concatenate([x[:1], x, x[-1:]]) for x in (t, v))
    slopes: Floats = (v[2:] - v[:-2]) / (t[2:] - t[:-2])
    return slopes
