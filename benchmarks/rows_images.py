"""Rows of the table of truth: surfaces from images and label maps."""

from __future__ import annotations

from functools import partial

import numpy as np
from drawn_labels import CAVITY, drawn_maps
from drawn_labels import torn as torn_map
from experiments import Row, experiment
from judged_images import drawn_figures, labelled, phantoms, real_images, tracked, valve_figures
from judged_tracks import (
    Judged,
    standard_figures,
    standard_rows,
    strain_figures,
    strain_rows,
)
from seen_surfaces import Truth

from modalmotion.tracking import track

_KINDS = (
    ("ct", "CT of 1.5 mm", 0.4, 1.0, 6, 1.5),
    ("echo", "echo of 1.2 mm", 0.6, 1.5, 4, 1.0),
    ("mri", "MRI of 1.4 x 1.4 x 8 mm", 0.6, 1.5, 6, 1.0),
    ("cine", "cine of 9 planes", 0.6, 1.5, 6, 1.0),
)


def _track(
    kind: str, n: int, seed: int, cover: bool = True, strain: bool = True, **set_to: float
) -> tuple[float, ...]:
    cases = phantoms(kind, seed, n, 3, **set_to)
    results = [Judged.of(tracked(one), Truth.of(one.truth)) for one in cases]
    return (*standard_figures(results, cover=cover), *(strain_figures(results) if strain else ()))


for _kind, _what, _distance, _spread, _n, _coarse in _KINDS:
    _rows = (
        *standard_rows(f"images.{_kind}", _what, _distance, _spread),
        *strain_rows(f"images.{_kind}", _what),
    )
    experiment(*_rows, quick=_kind == "mri")(partial(_track, _kind, _n, coarseness=_coarse))


@experiment(*standard_rows("images.labels", "label maps of 1.5 mm", 0.4, 1.0))
def labels(seed: int) -> tuple[float, ...]:
    cases = [(labelled(one, 1.5), one) for one in phantoms("ct", seed, 5, 3, coarseness=4.0)]
    tracks = ((track(made.images, landmarks=made.landmarks), one) for made, one in cases)
    return standard_figures([Judged.of(result, Truth.of(one.truth)) for result, one in tracks])


def _drawn_rows(name: str, what: str) -> tuple[Row, ...]:
    return (
        Row(f"{name}.median", f"median error of EF, {what}", "points", goal=1.5),
        Row(f"{name}.worst", f"largest error of EF, {what}", "points", goal=5),
        Row(f"{name}.inside", f"true EF within the stated 95 %, {what}", goal=(0.9, 1)),
        Row(f"{name}.swapped", f"apex and base swapped, or refused, {what}", goal=0),
    )


@experiment(
    *_drawn_rows("images.drawn", "hand-drawn maps"),
    *_drawn_rows("images.drawn_bare", "hand-drawn maps without a wall"),
)
def drawn(seed: int) -> tuple[float, ...]:
    cases = list(drawn_maps(seed, 12))
    return (*drawn_figures(cases, ()), *drawn_figures(cases, (CAVITY,)))


@experiment(
    Row("images.torn.median", "median error of EF, maps of which one frame lacks half", "points"),
    Row("images.torn.inside", "true EF inside, maps of which one frame lacks half", goal=(0.9, 1)),
    Row("images.torn.volume", "true volume of that frame inside", goal=(0.9, 1)),
)
def torn(seed: int) -> tuple[float, ...]:
    """Take half of the slices out of one frame: each but the first, in turn."""
    off, inside, are_within = [], [], []
    for k, case in enumerate(drawn_maps(seed, 12)):
        frame = 1 + k % 3
        result = track(torn_map(case, frame).images, labels=(CAVITY,))
        found = Judged.of(result, case.truth)
        off.append(abs(found.off))
        inside.append(found.is_inside)
        assert result.volumes is not None
        assert result.volume_deviations is not None
        missed = result.volumes[frame] - abs(case.truth.volumes[frame])
        are_within.append(bool(abs(missed) <= 2.0 * result.volume_deviations[frame]))
    return float(np.median(off)), float(np.mean(inside)), float(np.mean(are_within))


@experiment(
    Row("images.valve_twice.volume", "volume error over its 95 %, valve at ED and ES", goal=1),
    Row("images.valve_twice.inside", "true EF inside, valve at ED and ES", goal=(0.9, 1)),
    Row("images.valve_once.volume", "volume error over its 95 %, valve at ED", goal=1),
    Row("images.valve_once.inside", "true EF inside, valve at ED", goal=(0.9, 1)),
)
def valve(seed: int) -> tuple[float, ...]:
    cases = [*phantoms("mri", seed, 3, 5), *phantoms("ct", seed, 3, 5, coarseness=2.0)]
    return (*valve_figures(cases, at_systole=True), *valve_figures(cases, at_systole=False))


@experiment(
    *standard_rows("images.shifted", "cine with slices 2 mm aside", 0.8, 1.5, cover=False),
    *standard_rows("images.trabeculae", "these with trabeculae", 1.0, 1.5, cover=False),
    *strain_rows("images.trabeculae", "these with trabeculae"),
)
def shifted(seed: int) -> tuple[float, ...]:
    of = partial(_track, "cine", 5, seed, cover=False, slice_shift=2.0)
    return (*of(trabeculae=0, strain=False), *of(trabeculae=6))


experiment(
    Row("images.real.distance", "cine MRI to contours of it", "mm", goal=2, tolerance=0.05),
    Row("images.real.ef", "EF beside a fitted mesh's", "points", goal=6, tolerance=0.5),
    Row("images.real.r", "volumes with its", better="higher", goal=0.98, tolerance=0.003),
    needs=("cine/dicom", "cine/contours", "heart/lv_endocardium"),
)(real_images)
