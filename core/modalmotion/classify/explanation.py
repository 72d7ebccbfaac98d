"""What moved a prediction: which modes, by how much, in millimetres."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ModeContribution:
    """What one mode, or a cosine-sine pair of them, did to a prediction.

    Parameters
    ----------
    modes : tuple of str
        Labels of the modes.
    score : float
        What their amplitudes added to the log of (probability of the most probable class over
        that of the next), beyond those of an average training case.
    amplitude : float, `unit`
        RMS over time of their deviation from the temporal mean.
    unit : str or None
    """

    modes: tuple[str, ...]
    score: float
    amplitude: float
    unit: str | None
