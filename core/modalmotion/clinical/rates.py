"""How fast a cavity empties and fills, how often it beats, and what it pumps in a minute."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.clinical.readouts import ClinicalReadouts
from modalmotion.errors import ParameterError
from modalmotion.representation import shown


@shown("heart_rate", "cardiac_output", "peak_ejection_rate", "peak_filling_rate")
@dataclass(frozen=True)
class Rates:
    """Rates of a beating cavity; volumes in the readouts' `volume_unit`.

    Parameters
    ----------
    peak_ejection_rate, peak_filling_rate : float, volume per s
        Largest fall and rise of the volume, by central differences of neighbouring frames; both
        positive.
    ejection_bound, filling_bound : float, volume per s
        What the volumes' own bounds put on them.
    ejection_frame, filling_frame : int
        Where they are.
    heart_rate : float or None, beats per minute
        None where no period is stated.
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
            remedy="State times or the interval of frames (--frame-interval).",
        )
    volumes, bounds = readouts.curve.volumes * factor, readouts.curve.bounds * factor
    rates, errors = _derivatives(times, volumes, bounds, period)
    fall, rise = int(np.argmin(rates)), int(np.argmax(rates))
    heart_rate = output = interval = None
    if period is not None:
        heart_rate = 60.0 / period
        output = readouts.curve.stroke_volume * factor * heart_rate
        low, high = readouts.curve.stroke_range
        interval = (low * factor * heart_rate, high * factor * heart_rate)
    return Rates(
        peak_ejection_rate=max(0.0, -float(rates[fall])),
        peak_filling_rate=max(0.0, float(rates[rise])),
        ejection_bound=float(errors[fall]),
        filling_bound=float(errors[rise]),
        ejection_frame=fall,
        filling_frame=rise,
        heart_rate=heart_rate,
        cardiac_output=output,
        output_range=interval,
    )


def _derivatives(
    times: NDArray[np.float64],
    volumes: NDArray[np.float64],
    bounds: NDArray[np.float64],
    period: float | None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Central differences, around the cycle where it closes, and their bounds."""
    t, v, b = times, volumes, bounds
    span = float(t[-1] - t[0])
    closes = period is not None and period > span + 0.5 * span / (len(t) - 1)
    if closes and period is not None:
        t = np.concatenate([[t[-1] - period], t, [t[0] + period]])
        v, b = (np.concatenate([[a[-1]], a, [a[0]]]) for a in (v, b))
    else:
        # At the ends there is one side only.
        t = np.concatenate([t[:1], t, t[-1:]])
        v, b = (np.concatenate([a[:1], a, a[-1:]]) for a in (v, b))
    steps = t[2:] - t[:-2]
    return (v[2:] - v[:-2]) / steps, (b[2:] + b[:-2]) / steps
