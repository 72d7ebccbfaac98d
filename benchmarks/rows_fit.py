"""Rows of the table of truth: errors of a fit, choice of modes, noise, deviations of amplitudes."""

from __future__ import annotations

import statistics
from contextlib import suppress

import numpy as np
from experiments import Row, experiment, rows
from fit_truth import deviations_of, excess_of
from measure import medians
from mixed_noise import with_noise
from noisy_surfaces import (
    closed_body,
    drawn_noise,
    hull,
    individual,
    moving_body,
    moving_tube,
    smoothed,
)
from real_data import recording

import modalmotion as mm
from modalmotion.choice.parameters import ErrorKind
from modalmotion.template import make_template

COUNTS = (7, 18, 54)
REAL = {
    "endocardium": ("heart/lv_endocardium", COUNTS),
    "epicardium": ("heart/epicardium", COUNTS),
    "tongue": ("tongue/00_pada", (4, 7, 10)),
    "fox": ("fox/walk", COUNTS),
}
TOLERANCES = (2.0, 1.0, 0.6)


def _errors(name: str, counts: tuple[int, ...], tolerance: float | None) -> list[Row]:
    said = {"rms": "RMS", "max": "largest error"}
    return [
        Row(f"fit.{name}.{n}.{what}", f"{words} left by {n} modes: {name}", tolerance=tolerance)
        for n in counts
        for what, words in said.items()
    ]


def _left(sequence: mm.MeshSequence, counts: tuple[int, ...]) -> list[float]:
    asked = (mm.modal_signature(sequence, mm.SignatureParameters(modes=n)) for n in counts)
    return [error for made in asked for error in (made.rms_error, made.max_error)]


@experiment(
    *(row for name, (_, counts) in REAL.items() for row in _errors(name, counts, 0.0)),
    quick=True,
    needs=tuple(name for name, _ in REAL.values()),
)
def recorded(_: int) -> tuple[float, ...]:
    return tuple(x for name, counts in REAL.values() for x in _left(recording(name), counts))


@experiment(*_errors("lattice", COUNTS, None), *_errors("triangulated", COUNTS, None))
def simulated(seed: int) -> tuple[float, ...]:
    """Means over eight individuals."""
    of_each = []
    for k in range(8):
        lattice = individual(np.random.default_rng([seed, k]), grid=(32, 64))
        triangulated = individual(np.random.default_rng([seed, k]))
        of_each.append(_left(lattice, COUNTS) + _left(triangulated, COUNTS))
    return tuple(np.mean(of_each, axis=0).tolist())


@experiment(
    *rows(TOLERANCES, "fit.smallest.{:g}", "modes that hold {:g} mm, endocardium", tolerance=0),
    quick=True,
    needs=("heart/lv_endocardium",),
)
def smallest(_: int) -> tuple[float, ...]:
    sequence = recording("heart/lv_endocardium")
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
    excess, ratios, inside = [], [], []
    for k in range(20):
        rng = np.random.default_rng([seed, k])
        make = (individual, individual, individual, moving_body, moving_tube)[k % 5]
        clean = make(rng, n_frames=int(rng.choice([10, 16, 25, 40])))
        sigma, noisy = drawn_noise(clean, rng)
        made = mm.modal_signature(noisy, mm.SignatureParameters(auto=True))
        assert made.choice is not None
        noise = made.choice.noise
        assert noise is not None
        excess.append(excess_of(clean, noisy, len(made.modes)))
        ratios.append(noise.sigma / sigma)
        inside.append(noise.lowest <= sigma <= (noise.highest or 0.0))
    spread = max(max(ratios), 1 / min(ratios))
    middle = (statistics.median(excess), max(excess), statistics.median(ratios), spread)
    return (*middle, 100 * float(np.mean(inside)))


@experiment(
    Row("fit.deviations.independent", "stated over true deviation of amplitudes", goal=(0.9, 1.15)),
    Row("fit.deviations.mixed", "the same, noise mixed over neighbours", goal=(0.8, 1.25)),
    Row("fit.deviations.worst", "the same, independent, furthest surface, as a factor", goal=1.25),
    Row("fit.deviations.own", "true deviation over that on a fixed template, largest", goal=1.5),
    needs=("heart/lv_endocardium", "heart/epicardium"),
)
def deviations(seed: int) -> tuple[float, ...]:
    """Of five surfaces, 7 modes, 0.6 mm, on templates made from the noisy recording; 60 draws."""
    rng = np.random.default_rng([seed, 0])
    surfaces = [
        smoothed("heart/lv_endocardium"),
        smoothed("heart/epicardium"),
        *(make(rng) for make in (individual, moving_body, moving_tube)),
    ]
    pooled, by_surface, own = [], [], []
    for n_mixings in (0, 5):
        stated, true, fixed = (
            np.array(each)
            for each in zip(
                *(deviations_of(clean, n_mixings, rng) for clean in surfaces), strict=True
            )
        )
        pooled.append(float(np.sqrt((stated**2).sum() / (true**2).sum())))
        by_surface.append(max(np.maximum(stated / true, true / stated)))
        own.append(float((true / fixed).max()))
    return (*pooled, by_surface[0], own[0])


@experiment(
    Row("fit.kind.changed", "of 100 closed surfaces, kind of modes changed by 0.5 mm"),
    Row("fit.kind.unnoted", "the same without a note on the border", goal=0),
)
def kind(seed: int) -> tuple[float, float]:
    """Count on both sides of the border between sphere and modes of the mesh, most near it."""
    changed = unnoted = 0
    for k in range(100):
        rng = np.random.default_rng([seed, k])
        x = closed_body(rng, bend=rng.uniform(0.0, 0.02))
        shapes = (x, x + rng.normal(0.0, 0.5, x.shape))
        made = [make_template(mm.mesh_sequence(y[None], hull(), unit="mm")) for y in shapes]
        differ = made[0].surface != made[1].surface
        changed += differ
        unnoted += differ and not all("border" in " ".join(each.notes) for each in made)
    return changed, unnoted


@experiment(
    Row("fit.time.deviations", "deviations=true over plain seven modes, real heart", goal=3),
    Row("fit.time.auto", "`auto` over plain seven modes, real heart", goal=6),
    Row("fit.time.refusal", "to refuse what 500 vertices cannot hold over a plain fit", goal=50),
    needs=("heart/lv_endocardium",),
    is_timed=True,
)
def times(seed: int) -> tuple[float, ...]:
    heart = recording("heart/lv_endocardium")
    small = individual(np.random.default_rng([seed, 0]), n_vertices=500)
    small = with_noise(small, 0.5, np.random.default_rng([seed, 1]))

    def refuse() -> None:
        for kind in (ErrorKind.RMS, ErrorKind.MAX):
            with suppress(mm.ToleranceError):
                mm.modal_signature(small, mm.SignatureParameters(tolerance=1e-3, tolerance_of=kind))

    calls = {
        "plain": lambda: mm.modal_signature(heart),
        "deviations": lambda: mm.modal_signature(heart, mm.SignatureParameters(deviations=True)),
        "auto": lambda: mm.modal_signature(heart, mm.SignatureParameters(auto=True)),
        "small": lambda: mm.modal_signature(small),
        "refusal": refuse,
    }
    plain, with_deviations, auto, few, refusal = medians(calls, 5)
    return with_deviations / plain, auto / plain, refusal / few
