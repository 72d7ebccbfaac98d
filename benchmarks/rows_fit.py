"""Rows of the table of truth: errors of a fit, choice of modes, noise, deviations of amplitudes."""

from __future__ import annotations

import numpy as np
from experiments import Row, experiment, quick, rows, timed
from fit_truth import auto_of, changed_kind, pooled_deviations, times_of
from noisy_surfaces import individual
from real_data import recording

import modalmotion as mm

HEART, OUTER = "heart/lv_endocardium", "heart/epicardium"
REAL = {"endocardium": HEART, "epicardium": OUTER, "tongue": "tongue/00_pada", "fox": "fox/walk"}
TOLERANCES = (2.0, 1.0, 0.6)


def _counts(name: str) -> tuple[int, ...]:
    return (4, 7, 10) if name == "tongue" else (7, 18, 54)


def _errors(name: str, tolerance: float | None = None) -> list[Row]:
    return [
        Row(f"fit.{name}.{n}.{what}", f"{words} left by {n} modes: {name}", tolerance=tolerance)
        for n in _counts(name)
        for what, words in (("rms", "RMS"), ("max", "largest error"))
    ]


def _left(name: str, sequence: mm.MeshSequence) -> list[float]:
    asked = [mm.SignatureParameters(modes=n) for n in _counts(name)]
    made = [mm.modal_signature(sequence, each) for each in asked]
    return [error for each in made for error in (each.rms_error, each.max_error)]


@quick(*(row for name in REAL for row in _errors(name, 0.0)), needs=tuple(REAL.values()))
def recorded(_: int) -> tuple[float, ...]:
    return tuple(x for name, path in REAL.items() for x in _left(name, recording(path)))


@experiment(*_errors("lattice"), *_errors("triangulated"))
def simulated(seed: int) -> tuple[float, ...]:
    """Means over eight individuals."""
    kinds: dict[str, tuple[int, int] | None] = {"lattice": (32, 64), "triangulated": None}
    errors = [
        [_left(name, individual(np.random.default_rng([seed, k]), grid=grid)) for k in range(8)]
        for name, grid in kinds.items()
    ]
    return tuple(np.mean(errors, axis=1).ravel().tolist())


@quick(
    *rows(TOLERANCES, "fit.smallest.{:g}", "modes that hold {:g} mm, endocardium", tolerance=0),
    needs=(HEART,),
)
def smallest(_: int) -> tuple[float, ...]:
    sequence = recording(HEART)
    asked = (mm.SignatureParameters(tolerance=t) for t in TOLERANCES)
    return tuple(len(mm.modal_signature(sequence, each).modes) for each in asked)


@experiment(
    Row("fit.auto.excess", "error of `auto` over the best set's: median of 20 noises", goal=1.05),
    Row("fit.auto.worst", "the same, largest", goal=1.25),
    Row("fit.noise.ratio", "stated over true noise: median", goal=(0.97, 1.03)),
    Row("fit.noise.spread", "largest factor between stated and true noise", goal=1.3),
    Row("fit.noise.inside", "true noise within the stated range", "%", goal=(92, 100)),
)
def auto(seed: int) -> tuple[float, ...]:
    found = [auto_of(np.random.default_rng([seed, k]), k) for k in range(20)]
    excess, ratios, inside = np.array(found).T
    spread = max(ratios.max(), 1 / ratios.min())
    worst = float(np.median(excess)), excess.max(), float(np.median(ratios)), spread
    return (*worst, 100 * float(np.mean(inside)))


experiment(
    Row("fit.deviations.independent", "stated over true deviation of amplitudes", goal=(0.9, 1.15)),
    Row("fit.deviations.mixed", "the same, noise mixed over neighbours", goal=(0.8, 1.25)),
    Row("fit.deviations.worst", "the same, independent, furthest surface, as a factor", goal=1.25),
    Row("fit.deviations.own", "true deviation over that on a fixed template, largest", goal=1.5),
    Row("fit.deviations.marked", "stated over true, apex and a wall stated", goal=(0.9, 1.15)),
    needs=(HEART, OUTER),
)(pooled_deviations)


@experiment(
    Row("fit.kind.changed", "of 100 closed surfaces, kind of modes changed by 0.5 mm"),
    Row("fit.kind.unnoted", "the same without a note on the border", goal=0),
)
def kind(seed: int) -> tuple[float, ...]:
    found = [changed_kind(np.random.default_rng([seed, k]), 0.5) for k in range(100)]
    return tuple(np.sum(found, axis=0).tolist())


@timed(
    Row("fit.time.deviations", "deviations=true over plain seven modes, real heart", goal=3),
    Row("fit.time.auto", "`auto` over plain seven modes, real heart", goal=6),
    Row("fit.time.refusal", "to refuse what 500 vertices cannot hold over a plain fit", goal=50),
    needs=(HEART,),
)
def times(seed: int) -> tuple[float, ...]:
    plain, with_deviations, with_auto, few, refusal = times_of(recording(HEART), seed)
    return with_deviations / plain, with_auto / plain, refusal / few
