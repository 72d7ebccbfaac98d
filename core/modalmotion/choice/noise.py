"""The measurement's noise, estimated from a sequence itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.sequence import MEAN, Reference
from modalmotion.representation import shown

WIDE: Final = 1.5
"""Ends of the range that differ by more say that motion and noise cannot be told apart well."""


@shown("sigma", "lowest", "highest", "between_frames", "between_neighbours")
@dataclass(frozen=True)
class Noise:
    """Noise of each coordinate of each vertex in each frame.

    Parameters
    ----------
    sigma : float, length unit
        Standard deviation, `rounding` at least.
    lowest, highest : float, length unit
        Range of the standard deviation; no highest where nothing bounds it: one frame.
    between_frames : float
        Correlation of a vertex's noise in one frame with that in the next.
    between_neighbours : float
        Correlation of the noise of two neighbours in one frame.
    independent_vertices : float
        Vertices of independent noise that average like these.
    mixed : int
        Times that independent noise is to be averaged over neighbours to be as smooth.
    rounding : float, length unit
        Noise from storing the coordinates in their type.
    modes : int
        Spatial modes that were told apart.
    """

    sigma: float
    lowest: float
    highest: float | None
    between_frames: float
    between_neighbours: float
    independent_vertices: float
    mixed: int
    rounding: float
    modes: int

    def note(self, unit: str | None) -> str:
        """Describe the estimate and what it rests on."""
        unit = unit or "length units"
        size = f"{self.sigma:.3g} {unit}"
        if self.highest is None:
            return f"One frame is too few to estimate noise; {size} was assumed."
        if self.sigma <= self.rounding:
            return (
                f"The noise is that of the stored numbers, {size} a coordinate; no other shows, so "
                "modes are added until they describe rounding. Ask by tolerance for fewer."
            )
        text = (
            f"The noise was estimated at {size} a coordinate (standard deviation; between "
            f"{self.lowest:.3g} and {self.highest:.3g} {unit}), with correlations of "
            f"{self.between_neighbours:.2f} between neighbours and {self.between_frames:.2f} "
            f"between frames, from {self.modes} modes and what they leave."
        )
        if self.highest > WIDE * self.lowest:
            text += " Motion and noise are hard to tell apart here."
        return text

    def displacement_rms(self, n_frames: int, reference: Reference, n_directions: int = 3) -> float:
        """RMS displacement that noise alone makes, the reference's own included, length unit."""
        return self.sigma * float(np.sqrt(n_directions * self.spread(n_frames, reference)))

    def spread(self, n_frames: int, reference: Reference) -> float:
        """Mean square of a coordinate's displacement by noise of variance 1."""
        correlations = over_time(self.between_frames, n_frames)
        if reference == MEAN:
            return 1.0 - float(correlations.mean())
        return 2.0 * (1.0 - float(correlations[reference].mean()))


def over_time(correlation: float, n_frames: int) -> NDArray[np.float64]:
    """Correlations of the noise of any two frames, (frames, frames) float64."""
    lags = np.abs(np.subtract.outer(np.arange(n_frames), np.arange(n_frames)))
    result: NDArray[np.float64] = np.float64(correlation) ** lags
    return result
