"""Tracks beside surfaces that are known: distance, ejection fraction, what is stated of both."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from experiments import Row
from numpy.typing import NDArray
from seen_surfaces import Seen, Truth, sampled
from strain_truth import strain_truth

from modalmotion.clinical import clinical_readouts
from modalmotion.clinical.strain_of import strain as measured_strain
from modalmotion.errors import InputError
from modalmotion.signature.making import modal_signature
from modalmotion.tracking import Track, track
from modalmotion.tracking.closest import closest_points
from modalmotion.tracking.reading import Recorded

Floats = NDArray[np.float64]

# Of the height of an open surface: beyond it landmarks place the surface, and not what is seen.
_INNER = 0.97

# The best published variability of GLS, and half the best error of GCS, percentage points.
GOALS = {"GLS": 1.4, "GCS": 1.5}
# Intervals of strain that are wider, points, count as a miss.
WIDEST = 6.0


@dataclass(frozen=True)
class Judged:
    """Errors of a track, and what it states of them.

    Parameters
    ----------
    distance : float, mm
        Mean of both ways, of every other frame.
    off, bound : float, percentage points
        Of the ejection fraction: the error, and half the width of the stated interval.
    ratios : (n,) float64
        Distances of vertices from the true surface over the stated deviations.
    told : float
        Interval that the track's read-outs state over that of the track, at most 1.
    strain : tuple of (float, bool)
        Error of GLS and of GCS, percentage points, each with whether the truth is within its
        interval and that no wider than 6 points. None of what is no ventricle's lattice.
    """

    distance: float
    off: float
    bound: float
    ratios: Floats
    told: float
    strain: tuple[tuple[float, bool], ...]

    @staticmethod
    def of(result: Track, truth: Truth) -> Judged:
        """Compare a track with the true surface."""
        faces, found = result.template.faces, result.sequence.vertices.astype(np.float64)
        inner = np.ones(found.shape[1], dtype=np.bool_)
        if truth.ends:
            inner = result.template.coordinates[:, 0] < _INNER
        distances, ratios = [], []
        for k, (x, y) in enumerate(zip(found, truth.vertices, strict=True)):
            if k % 2 == 0:
                distances.append(surface_distance(x, faces, y, truth.faces))
            if (sd := result.deviations[k, inner, 0]).any():
                ratios.append(closest_points(x[inner], y, truth.faces).distances / sd)
        off = (result.ejection_fraction or 0.0) - truth.ejection_fraction
        bound = result.ejection_fraction_bound or 0.0
        curve = clinical_readouts(modal_signature(result.sequence), result.sequence).curve
        told = min(1.0, (curve.share_bound or 0.0) / max(bound, 1e-9))
        strain = tuple(_judged_strain(result, truth)) if truth.grid else ()
        return Judged(float(np.mean(distances)), off, bound, np.concatenate(ratios), told, strain)

    @property
    def is_inside(self) -> bool:
        """Whether the true ejection fraction is within the interval."""
        return abs(self.off) <= self.bound


def _judged_strain(result: Track, truth: Truth) -> Iterator[tuple[float, bool]]:
    true = strain_truth(truth.sequence, by_length=True)
    found = measured_strain(result).end_systolic
    for name, value in (("GLS", true.gls), ("GCS", true.gcs)):
        own, low, high = found[name]
        yield own - value, low <= value <= high <= low + WIDEST


def judged(cases: Iterable[Seen], *, has_start: bool = True, **options: Any) -> list[Judged]:
    """Track what is seen, from the surface of frame 0 or from none; those that are not refused."""
    results = []
    for truth, seen in cases:
        start = truth.start() if has_start else None
        try:
            results.append(Judged.of(track(seen, start=start, unit="mm", **options), truth))
        except InputError:
            continue
    return results


def standard_rows(
    name: str, what: str, distance: float, spread: float, *, cover: bool = True
) -> tuple[Row, ...]:
    """Rows of one kind of data; goals of the distance, mm, and of the spread, points."""
    rows = (
        Row(f"{name}.distance", f"distance of surfaces from {what}", "mm", goal=distance),
        Row(f"{name}.ef_bias", f"mean error of EF from {what}", "points", goal=(-0.5, 0.5)),
        Row(f"{name}.ef_spread", f"deviation of it from {what}", "points", goal=spread),
        Row(f"{name}.ef_inside", f"true EF within the stated 95 % of {what}", goal=(0.9, 1)),
        Row(f"{name}.cover68", f"vertices within one deviation of {what}", goal=(0.65, 0.71)),
        Row(f"{name}.cover95", f"vertices within 1.96 deviations of {what}", goal=(0.92, 0.98)),
    )
    return rows if cover else rows[:4]


def standard_figures(results: Sequence[Judged], *, cover: bool = True) -> tuple[float, ...]:
    """Values of the standard rows."""
    off, ratios = (
        np.array([one.off for one in results]),
        np.concatenate([r.ratios for r in results]),
    )
    figures = (
        float(np.mean([one.distance for one in results])),
        float(off.mean()),
        float(off.std(ddof=1)),
        float(np.mean([one.is_inside for one in results])),
        *(float((ratios < limit).mean()) for limit in (1.0, 1.96)),
    )
    return figures if cover else figures[:4]


def strain_rows(name: str, what: str) -> tuple[Row, ...]:
    """Rows of strain from one kind of data."""
    return tuple(
        row
        for kind in ("GLS", "GCS")
        for row in (
            Row(f"{name}.{kind.lower()}", f"{kind} off by, {what}", "points", goal=GOALS[kind]),
            Row(f"{name}.{kind.lower()}_inside", f"true {kind} inside, {what}", goal=(0.92, 0.98)),
        )
    )


def strain_figures(results: Sequence[Judged]) -> tuple[float, ...]:
    """Values of the rows of strain."""
    off, inside = np.moveaxis(np.array([one.strain for one in results], dtype=np.float64), 2, 0)
    means = np.abs(off).mean(axis=0), inside.mean(axis=0)
    return tuple(float(value) for pair in zip(*means, strict=True) for value in pair)


def surface_distance(
    x: Floats, faces: NDArray[np.int64], y: Floats, others: NDArray[np.int64]
) -> float:
    """Mean distance of two surfaces, both ways."""
    rng = np.random.default_rng(0)
    one = closest_points(sampled(x, faces, 4000, rng), y, others).distances
    two = closest_points(sampled(y, others, 4000, rng), x, faces).distances
    return float(one.mean() + two.mean()) / 2


def beside_contours(result: Track, recorded: Recorded, mesh: Truth) -> tuple[float, float, float]:
    """Mean distance of a real heart's contours, mm; EF beside the mesh's, points; correlation."""
    off = [
        closest_points(
            frame[0].points, x.astype(np.float64), result.template.faces
        ).distances.mean()
        for frame, x in zip(recorded.frames, result.sequence.vertices, strict=True)
    ]
    assert result.volumes is not None
    own, other = result.volumes, mesh.volumes
    # From frame 0, where the contours have end diastole.
    apart = 100.0 * abs(own.min() / own[0] - other.min() / other[0])
    return float(np.mean(off)), float(apart), float(np.corrcoef(own, other)[0, 1])
