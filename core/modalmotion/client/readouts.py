"""Volumes and their shares as the service states them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.client.errors import understood
from modalmotion.representation import shown

Interval = tuple[float, float, float]
"""A number and the ends of its 95 % interval."""


@shown("end_systolic", "peak")
@dataclass(frozen=True, eq=False)
class StrainFigure:
    """A strain since end diastole, percent: negative where the wall is shorter.

    Parameters
    ----------
    end_systolic, peak : Interval
    curve, deviations : (frames,) float64
        With its standard deviations, points.
    """

    end_systolic: Interval
    peak: Interval
    curve: NDArray[np.float64]
    deviations: NDArray[np.float64]


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
    strain : dict of str to StrainFigure
        By name: GLS, GCS, GAS and GCS of each level; none where the surface is no wall.
    dyssynchrony : Interval or None, percent of the cycle
        Systolic dyssynchrony index.
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
    strain: dict[str, StrainFigure]
    dyssynchrony: Interval | None
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
        strain = answer["strain"] or {"figures": [], "dyssynchrony": None}
        uneven = strain["dyssynchrony"]
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
            strain={one["name"]: _strain(one) for one in strain["figures"]},
            dyssynchrony=None if uneven is None else _interval(uneven),
            notes=answer["notes"],
            answer=answer,
        )


def _value(figure: Any) -> float | None:
    return None if figure is None else float(figure["value"])


def _interval(figure: Any) -> Interval:
    return figure["value"], figure["low"], figure["high"]


def _strain(figure: Any) -> StrainFigure:
    return StrainFigure(
        _interval(figure["end_systolic"]),
        _interval(figure["peak"]),
        np.array(figure["curve"], dtype=np.float64),
        np.array(figure["deviations"], dtype=np.float64),
    )
