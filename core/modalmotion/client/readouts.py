"""Volumes and their shares as the service states them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.client.errors import understood
from modalmotion.representation import shown


@shown("ejection_fraction", "volume_change", "share_range", "volume_unit", "volumes")
@dataclass(frozen=True, eq=False)
class Readouts:
    """Volume over time, and the share of it that is lost.

    Parameters
    ----------
    volume_unit : str
        ml; cubed length units where the unit is unknown.
    times : (frames,) float64, s, or None
    volumes, bounds : (frames,) float64, `volume_unit`
        From the signature; the surface's own volume differs by at most the bound.
    ejection_fraction, volume_change : float or None, percent
        The share by its name: the first where the surface is that of a cavity. Both are None of
        one frame, and where a volume is not positive.
    share_range : tuple of float or None, percent
    mesh_volumes : (frames,) float64, `volume_unit`
        Of the frames as sent.
    mesh_ejection_fraction, mesh_volume_change : float or None, percent
    notes : list of str
    answer : dict
        The full answer of the service.
    """

    volume_unit: str
    times: NDArray[np.float64] | None
    volumes: NDArray[np.float64]
    bounds: NDArray[np.float64]
    ejection_fraction: float | None
    volume_change: float | None
    share_range: tuple[float, float] | None
    mesh_volumes: NDArray[np.float64]
    mesh_ejection_fraction: float | None
    mesh_volume_change: float | None
    notes: list[str]
    answer: dict[str, Any] = field(repr=False)


def readouts_of(answer: Any) -> Readouts:
    """Read volumes and their shares.

    Raises
    ------
    BrokenAnswerError
        If a member is missing.
    """
    with understood("a description of volumes"):
        own, mesh, times = answer["from_signature"], answer["of_mesh"], answer["times"]
        shares = own["ejection_fraction"] or own["volume_change"]
        return Readouts(
            volume_unit=answer["volume_unit"],
            times=None if times is None else np.array(times, dtype=np.float64),
            volumes=np.array(own["volumes"], dtype=np.float64),
            bounds=np.array(own["bounds"], dtype=np.float64),
            ejection_fraction=_value(own["ejection_fraction"]),
            volume_change=_value(own["volume_change"]),
            share_range=None if shares is None else (shares["low"], shares["high"]),
            mesh_volumes=np.array(mesh["volumes"], dtype=np.float64),
            mesh_ejection_fraction=_value(mesh["ejection_fraction"]),
            mesh_volume_change=_value(mesh["volume_change"]),
            notes=answer["notes"],
            answer=answer,
        )


def _value(figure: Any) -> float | None:
    return None if figure is None else float(figure["value"])
