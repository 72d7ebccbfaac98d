"""What a track from images says of them."""

from __future__ import annotations

from dataclasses import dataclass

from modalmotion.representation import shown
from modalmotion.tracking.papillary import Papillary


@shown("papillary", "papillary_volume", "inside", "outside", "shift_sd")
@dataclass(frozen=True)
class ImageAnswer:
    """Convention, brightness and slices of a track from images.

    Parameters
    ----------
    papillary : {"pool", "wall"}
        Convention of volumes: papillary muscles are cavity, or not.
    papillary_volume : float, mm^3
        That looks like muscle within the surface; it is taken off each volume under `wall`.
    inside, outside, spread : float
        Brightness on both sides in the reference frame, and the deviation of its noise.
    slope : tuple of float, 1 / mm
        Of the bias field.
    shifts : tuple of (float, float, float), mm
        By which each slice shows everything aside; none of volumes.
    shift_sd : float, mm
        Of a shift along one axis.
    found : tuple of float
        Share of the profiles with an edge in each frame.
    localisation : float, mm
        Deviation that all edges have in common, in volumes too.
    bent : float, mm
        Deviation that shifts of slices leave, RMS over the surface.
    volume_correlation : float
        Of the errors of the largest and the smallest volume: that of a proposed base is alike in
        both.
    """

    papillary: Papillary
    papillary_volume: float
    inside: float
    outside: float
    spread: float
    slope: tuple[float, ...]
    shifts: tuple[tuple[float, ...], ...]
    shift_sd: float
    found: tuple[float, ...]
    localisation: float
    bent: float
    volume_correlation: float = 0.0

    def __post_init__(self) -> None:
        # JSON knows lists only.
        for name in ("slope", "found"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        object.__setattr__(self, "shifts", tuple(tuple(row) for row in self.shifts))
