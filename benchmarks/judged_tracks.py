"""Tracks beside surfaces that are known: distance, ejection fraction, what is stated of both."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from experiments import Row
from measure import medians
from numpy.typing import NDArray
from read_hearts import true_strain
from real_data import DATA, recording
from seen_surfaces import Seen, Truth, sampled, ventricles

import modalmotion as mm
from modalmotion.signature.making import modal_signature
from modalmotion.tracking import Track, track
from modalmotion.tracking.closest import closest_points
from modalmotion.tracking.reading import Recorded, read_observed

Floats = NDArray[np.float64]

CONTOURS = DATA / "cine" / "contours"

_INNER = 0.97  # height beyond which landmarks place an open surface, and not what is seen

# The best published variability of GLS, and half the best error of GCS, percentage points.
GOALS = {"GLS": 1.4, "GCS": 1.5}
WIDEST = 6.0  # points; wider intervals of strain count as a miss


@dataclass(frozen=True)
class Judged:
    """Errors of a track, and what it states of them."""

    distance: float  # mm, mean of both ways, of every other frame
    off: float  # error of the ejection fraction, percentage points
    bound: float  # half the width of its stated interval
    ratios: Floats  # (n,), distances of vertices from the true surface over stated deviations
    told: float  # interval that the track's read-outs state over that of the track, at most 1
    strain: tuple[tuple[float, bool], ...]  # error of GLS and GCS, and whether it is inside

    @staticmethod
    def of(result: Track, truth: Truth) -> Judged:
        """Compare a track with the true surface."""
        faces, found = result.template.faces, result.sequence.vertices.astype(np.float64)
        inner = result.template.coordinates[:, 0] < (_INNER if truth.ends else np.inf)
        distances, ratios = [], []
        for k, (x, y) in enumerate(zip(found, truth.vertices, strict=True)):
            if k % 2 == 0:
                distances.append(surface_distance(x, faces, y, truth.faces))
            if (sd := result.deviations[k, inner, 0]).any():
                ratios.append(closest_points(x[inner], y, truth.faces).distances / sd)
        off = (result.ejection_fraction or 0.0) - truth.ejection_fraction
        bound = result.ejection_fraction_bound or 0.0
        curve = mm.clinical_readouts(modal_signature(result.sequence), result.sequence).curve
        told = min(1.0, (curve.share_bound or 0.0) / max(bound, 1e-9))
        strain = tuple(_judged_strain(result, truth)) if truth.grid else ()
        return Judged(float(np.mean(distances)), off, bound, np.concatenate(ratios), told, strain)

    @property
    def is_inside(self) -> bool:
        """Whether the true ejection fraction is within the interval."""
        return abs(self.off) <= self.bound


def _judged_strain(result: Track, truth: Truth) -> Iterator[tuple[float, bool]]:
    still = mm.mesh_sequence(truth.vertices, truth.faces, grid=truth.grid, unit="mm")
    true, found = true_strain(still), mm.strain(result).end_systolic
    for name in GOALS:
        (own, low, high), value = found[name], true[name.lower()]
        yield own - value, low <= value <= high <= low + WIDEST


def judged(cases: Iterable[Seen], *, has_start: bool = True, **options: Any) -> list[Judged]:
    """Track what is seen, from the surface of frame 0 or from none; those that are not refused."""
    results = []
    for truth, seen in cases:
        start = truth.start() if has_start else None
        try:
            results.append(Judged.of(track(seen, start=start, unit="mm", **options), truth))
        except mm.InputError:
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
    off, ratios = np.array([one.off for one in results]), [one.ratios for one in results]
    figures = (
        float(np.mean([one.distance for one in results])),
        float(off.mean()),
        float(off.std(ddof=1)),
        float(np.mean([one.is_inside for one in results])),
        *(float((np.concatenate(ratios) < limit).mean()) for limit in (1.0, 1.96)),
    )
    return figures if cover else figures[:4]


def strain_rows(name: str, what: str) -> tuple[Row, ...]:
    """Rows of strain from one kind of data."""
    return tuple(
        row
        for kind in GOALS
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


def beside_products(seed: int) -> float:
    """Time of a tracked frame of 2,000 points over that of a product of 1,000 x 1,000 numbers."""
    (truth, rng), *_ = ventricles(seed, 1)
    frames, matrix = truth.seen(2000, 1.0, rng), rng.normal(size=(1000, 1000))
    tracked = partial(track, frames, start=truth.start(), unit="mm")
    of_track, of_product = medians({"track": tracked, "product": lambda: matrix @ matrix}, 3)
    return of_track / len(frames) / of_product


def real_contours(_: int) -> tuple[float, float]:
    """Distance and EF of a track of a real heart's contours; see `beside_contours`."""
    recorded = read_observed(CONTOURS)
    result = track(recorded, topology="cup", unit="mm")
    return beside_contours(result, recorded)[:2]


def beside_contours(result: Track, recorded: Recorded) -> tuple[float, float, float]:
    """Mean distance of a real heart's contours, mm; EF beside its mesh's, points; correlation."""
    mesh = Truth.of(recording("heart/lv_endocardium"))
    pairs = zip(recorded.frames, result.sequence.vertices.astype(np.float64), strict=True)
    faces = result.template.faces
    off = [closest_points(seen[0].points, x, faces).distances.mean() for seen, x in pairs]
    assert result.volumes is not None
    own, other = result.volumes, mesh.volumes
    # From frame 0, where the contours have end diastole.
    apart = 100.0 * abs(own.min() / own[0] - other.min() / other[0])
    return float(np.mean(off)), float(apart), float(np.corrcoef(own, other)[0, 1])
