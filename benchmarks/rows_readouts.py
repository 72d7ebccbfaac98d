"""Rows of the table of truth: volumes, rates and strain of simulated ventricles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from experiments import Row, experiment
from read_hearts import MESHES, hearts, noisy, read, shrinking_ellipsoid, true_figures, volumes_of
from strain_truth import dyssynchrony_truth

import modalmotion as mm
from modalmotion.clinical.rates import rates_of
from modalmotion.simulate import Acquisition, MotionClass, draw_parameters, simulate_ventricle

NOISES = (0.0, 0.6, 1.0, 1.5)
FIGURES = {
    "ef": ("ejection fraction", "points"),
    "edv": ("end-diastolic volume", "%"),
    "gls": ("longitudinal strain", "points"),
    "gcs": ("circumferential strain", "points"),
    "gas": ("strain of the area", "points"),
}
# Mean absolute errors at 1 mm of noise or less, coarse mesh and others.
GOALS = {"gls": (0.6, 0.4), "gcs": (0.9, 0.6)}
N_PER_CLASS = 4
WIDEST = 6.0


def _rows(mesh: str) -> Iterator[Row]:
    for name, (words, unit) in FIGURES.items():
        goals = GOALS.get(name)
        goal = None if goals is None else goals[mesh != "16x32"]
        for noise in NOISES:
            text = f"{words} off by, {noise:g} mm of noise, {mesh}"
            yield Row(f"readouts.{mesh}.{name}.{noise:g}", text, unit, goal if noise <= 1 else None)
        text = f"{words} within its interval, noise of 0.6 to 1.5 mm, {mesh}"
        yield Row(f"readouts.{mesh}.{name}.inside", text, "%", goal=(92.0, 98.0))


def _measure(mesh: str, seed: int) -> tuple[float, ...]:
    errors: dict[str, dict[float, list[float]]] = {n: {s: [] for s in NOISES} for n in FIGURES}
    inside: dict[str, list[bool]] = {name: [] for name in FIGURES}
    for clean, truth, rng in hearts(mesh, seed, N_PER_CLASS):
        true = true_figures(clean, truth)
        for noise in NOISES:
            found = read(noisy(clean, noise, rng))
            for name, (value, low, high) in found.items():
                scale = 100 / true[name] if name == "edv" else 1.0
                errors[name][noise].append(scale * abs(value - true[name]))
                if noise:
                    is_narrow = name == "edv" or high - low <= WIDEST
                    inside[name].append(is_narrow and low <= true[name] <= high)
    return tuple(
        float(value)
        for name in FIGURES
        for value in (*map(np.mean, errors[name].values()), 100 * np.mean(inside[name]))
    )


for _mesh in MESHES:
    experiment(*_rows(_mesh), quick=_mesh == "16x32")(partial(_measure, _mesh))


@experiment(
    Row("readouts.meshes.clean", "strain of one heart on two meshes differs by", "points", 0.3),
    Row("readouts.meshes.noisy", "the same, 1 mm of noise", "points", 0.6),
)
def meshes(seed: int) -> tuple[float, ...]:
    """Beyond what the truth on both differs by, for each is contracted to its own volume."""
    off: dict[float, list[float]] = {0.0: [], 1.0: []}
    for pair in zip(hearts("16x32", seed, 2), hearts("32x64", seed, 2), strict=True):
        for noise, differences in off.items():
            found = [(read(noisy(heart, noise, rng)), truth) for heart, truth, rng in pair]
            one, other = (np.array([r["gls"][0] - t.gls, r["gcs"][0] - t.gcs]) for r, t in found)
            differences.append(float(np.abs(one - other).mean()))
    return tuple(float(np.mean(differences)) for differences in off.values())


@experiment(
    Row(
        "readouts.moved", "strain of a scaled, turned heart off by", "points", 1e-9, tolerance=1e-12
    ),
    Row("readouts.ellipsoid", "strain of ellipsoids off elliptic integrals by", "points", 0.1),
    quick=True,
)
def laws(seed: int) -> tuple[float, float]:
    clean, _, rng = next(hearts("16x32", seed, 1))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    here, there = read(clean), read(replace(clean, vertices=1.7 * clean.vertices @ turn + 40.0))
    off = []
    for _ in range(10):
        beat, strains = shrinking_ellipsoid(rng)
        found = read(beat)
        off.append([abs(found[name][0] - true) for name, true in strains.items()])
    changed = max(abs(here[name][0] - there[name][0]) for name in ("gls", "gcs"))
    return changed, float(np.mean(off))


@experiment(
    Row(
        "readouts.sdi.0", "dyssynchrony index of a late wall off by, 25 frames", "points", goal=0.5
    ),
    Row("readouts.sdi.1", "the same, 1 mm of noise", "points", goal=1.5),
    Row("readouts.sdi.inside", "index of a late wall within its interval", "%", goal=(92.0, 100.0)),
)
def late_walls(seed: int) -> tuple[float, ...]:
    off: dict[float, list[float]] = {0.0: [], 1.0: []}
    inside = []
    for k in range(12):
        state = [seed, k]
        parameters = draw_parameters(MotionClass.DYSSYNCHRONY, np.random.default_rng(state))
        many, few = (
            simulate_ventricle(
                parameters,
                grid=(24, 48),
                acquisition=Acquisition(n_frames=n),
                rng=np.random.default_rng(state),
            )
            for n in (400, 25)
        )
        true = dyssynchrony_truth(many)
        for noise, errors in off.items():
            found = mm.strain(noisy(few, noise, np.random.default_rng(state))).dyssynchrony
            assert found is not None
            errors.append(abs(found.value - true))
            inside.append(found.low <= true <= found.high)
    return (*(float(np.mean(each)) for each in off.values()), 100 * float(np.mean(inside)))


@experiment(
    Row("readouts.phases.off", "held-out frames off, of straight lines' error", goal=0.5),
    Row("readouts.phases.inside", "held-out coordinates within two deviations", goal=(0.9, 0.98)),
)
def phases(seed: int) -> tuple[float, float]:
    """Every second of 30 frames is held out, without noise and with 0.3 mm of it.

    Errors are those of the first, for noise of what is held out nothing foresees.
    """
    ratios, inside = [], []
    for k, label in enumerate(list(MotionClass) * 2):
        rng = np.random.default_rng([seed, k])
        frames = Acquisition(n_frames=30)
        parameters = draw_parameters(label, rng)
        clean = simulate_ventricle(parameters, grid=(12, 24), acquisition=frames, rng=rng)
        for noise in (0.0, 0.3):
            x = noisy(clean, noise, rng).vertices.astype(np.float64)
            known = replace(clean, vertices=x[::2], times=None)  # even steps of the cycle
            found = mm.resample(known, list((np.arange(15) + 0.5) / 15))
            errors = np.abs(found.sequence.vertices - x[1::2])
            inside.append(float((errors <= 2.0 * found.deviations[:, :, None]).mean()))
            if not noise:
                straight = (x[::2] + np.roll(x[::2], -1, axis=0)) / 2.0 - x[1::2]
                ratios.append(float(np.sqrt((errors**2).mean() / (straight**2).mean())))
    return float(np.mean(ratios)), float(np.mean(inside))


@experiment(
    Row("readouts.rates.16", "peak rates of 16 frames off by", "%", goal=1),
    Row("readouts.rates.41", "peak rates of 41 frames off by", "%", goal=0.5),
    Row("readouts.rates.inside", "peak rates within their bound", "%", goal=(92.0, 100.0)),
    quick=True,
)
def rates(seed: int) -> tuple[float, ...]:
    off: dict[int, list[float]] = {16: [], 41: []}
    inside = []
    for k, label in enumerate(list(MotionClass) * 4):
        parameters = draw_parameters(label, np.random.default_rng([seed, k]))
        beats = {
            n: simulate_ventricle(
                parameters,
                grid=(12, 24),
                acquisition=Acquisition(n_frames=n),
                rng=np.random.default_rng([seed, k, 1]),
            )
            for n in (*off, 600)
        }
        volumes = volumes_of(beats[600])
        slopes = np.diff(volumes, append=volumes[0]) * 600 / parameters.period
        true = -slopes.min() / 1000, slopes.max() / 1000
        for n in off:
            readouts = mm.clinical_readouts(mm.modal_signature(beats[n]), beats[n])
            found = rates_of(readouts, parameters.period)
            stated = (
                (found.peak_ejection_rate, found.ejection_bound),
                (
                    found.peak_filling_rate,
                    found.filling_bound,
                ),
            )
            for (value, bound), rate in zip(stated, true, strict=True):
                off[n].append(100 * abs(value - rate) / rate)
                inside.append(abs(value - rate) <= bound)
    return (*(float(np.mean(each)) for each in off.values()), 100 * float(np.mean(inside)))
