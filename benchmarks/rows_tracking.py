"""Rows of the table of truth: tracking without correspondence."""

from __future__ import annotations

from functools import partial
from itertools import chain

import numpy as np
from drawn_contours import contoured
from experiments import Row, experiment, quick, timed
from judged_tracks import (
    beside_products,
    judged,
    real_contours,
    standard_figures,
    standard_rows,
    strain_figures,
    strain_rows,
)
from real_data import recording
from seen_surfaces import Truth, dented, quartered, seen_clouds, ventricles

HEART = "heart/lv_endocardium"


@quick(
    *standard_rows("tracking.clouds", "clouds, 1 mm of noise, first surface known", 0.15, 0.3),
    Row("tracking.clouds.told", "their read-outs' interval of EF over theirs", goal=(1, 1)),
    *strain_rows("tracking.clouds", "clouds"),
)
def clouds(seed: int) -> tuple[float, ...]:
    results = judged(seen_clouds(ventricles(seed, 10), 1.0))
    told = float(np.mean([one.told for one in results]))
    return (*standard_figures(results), told, *strain_figures(results))


@experiment(*standard_rows("tracking.strays", "clouds with 30 % strays", 0.17, 0.4, cover=False))
def strays(seed: int) -> tuple[float, ...]:
    return standard_figures(judged(seen_clouds(ventricles(seed, 6), 1.0, strays=0.3)), cover=False)


@experiment(*standard_rows("tracking.shapes", "clouds without a known surface", 0.2, 0.3))
def shapes(seed: int) -> tuple[float, ...]:
    seen = seen_clouds(chain(ventricles(seed, 5), quartered(seed, 5)), 0.5, has_start=False)
    return standard_figures(judged(seen, has_start=False))


@experiment(*standard_rows("tracking.clouds_once", "clouds, ends at ED", 0.2, 0.5, cover=False))
def clouds_once(seed: int) -> tuple[float, ...]:
    seen = list(seen_clouds(ventricles(seed, 5), 1.0, has_start=False))
    for _, frames in seen:
        frames[1:] = [frame[:1] for frame in frames[1:]]
    return standard_figures(judged(seen, has_start=False), cover=False)


@experiment(
    Row("tracking.dents.rms", "RMS error of EF, motion finer than modes", "points", goal=0.2),
    Row("tracking.dents_known.rms", "the same, first surface known", "points", goal=0.2),
)
def dents(seed: int) -> tuple[float, ...]:
    seen = [(seen_clouds(dented(seed, 6), 0.5, has_start=known), known) for known in (False, True)]
    off = [[one.off for one in judged(cases, has_start=known)] for cases, known in seen]
    return tuple(float(np.sqrt(np.mean(np.square(each)))) for each in off)


@experiment(
    *standard_rows("tracking.holes", "clouds with a hole of 10 %", 0.2, 0.4, cover=False),
    Row("tracking.holes.refused", "clouds with a hole of 10 % that are refused", goal=0),
    Row("tracking.quarter.bias", "mean error of EF, a quarter unseen", "points", goal=(-0.5, 0.5)),
    Row("tracking.quarter.worst", "largest error of EF, a quarter unseen", "points", goal=4),
    Row("tracking.quarter.right", "true EF inside, or refused, a quarter unseen", goal=(0.9, 1)),
    Row("tracking.quarter.refused", "refused, a quarter unseen", goal=0.34),
    Row("tracking.quarter.width", "widest interval of EF, a quarter unseen", "points", goal=8),
)
def holes(seed: int) -> tuple[float, ...]:
    tenth, quarter = (
        judged(seen_clouds(both, 1.0, unseen=share, has_start=False), has_start=False)
        for share in (0.1, 0.25)
        for both in [chain(ventricles(seed, 4), quartered(seed, 4))]
    )
    off = np.array([one.off for one in quarter] or [0.0])
    wrong = sum(not one.is_inside for one in quarter) / 8
    width = 2 * max((one.bound for one in quarter), default=0.0)
    refused = [1 - len(found) / 8 for found in (tenth, quarter)]
    figures = (float(off.mean()), float(np.abs(off).max()), 1 - wrong, refused[1], width)
    return (*standard_figures(tenth, cover=False), refused[0], *figures)


@experiment(*standard_rows("tracking.remeshed", "meshes that change", 0.1, 0.2, cover=False))
def remeshed(seed: int) -> tuple[float, ...]:
    cases = ((truth, truth.remeshed(rng)) for truth, rng in ventricles(seed, 4))
    return standard_figures(judged(cases), cover=False)


def _contours(vanish: bool, seed: int) -> tuple[float, ...]:
    figures: list[float] = []
    for n_known in (6, 1):
        cases = contoured(seed, 8, n_known, vanish=vanish)
        results = judged(cases, has_start=False, topology="cup")
        figures += (*standard_figures(results, cover=False), *strain_figures(results))
    return tuple(figures)


for _vanish, _name, _what in (
    (False, "tracking.contours", "contours, valve"),
    (True, "tracking.vanish", "vanishing slices, ends"),
):
    experiment(
        *standard_rows(_name, f"{_what} in all frames", 0.5, 2, cover=False),
        *strain_rows(_name, f"{_what} in all frames"),
        *standard_rows(f"{_name}_once", f"{_what} in one frame", 0.5, 2, cover=False),
        *strain_rows(f"{_name}_once", f"{_what} in one frame"),
    )(partial(_contours, _vanish))


@quick(
    Row("tracking.heart.distance", "clouds of a real ventricle, 1 mm of noise", "mm", goal=0.25),
    Row("tracking.heart.ef", "size of the error of its EF", "points", goal=0.5),
    needs=(HEART,),
)
def heart(seed: int) -> tuple[float, ...]:
    truth = Truth.of(recording(HEART), every=4)
    (found,) = judged(seen_clouds([(truth, np.random.default_rng([seed, 4]))], 1.0))
    return found.distance, abs(found.off)


experiment(
    Row("tracking.real_contours.distance", "from real contours", "mm", goal=0.9, tolerance=0.02),
    Row("tracking.real_contours.ef", "EF beside a fitted mesh's", "points", 1.5, "lower", 0.2),
    needs=(HEART, "cine/contours"),
)(real_contours)

# pycpd takes 97 times as long for a pair of frames (docs/decisions/0033-tracking.md).
timed(Row("tracking.time", "time of a frame beside 1,000 x 1,000 products"))(beside_products)
