"""Rows of the table of truth: volumes, rates and strain of simulated ventricles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from experiments import Row, experiment, quick
from read_hearts import (
    MESHES,
    dyssynchrony_of,
    hearts,
    held_out_phases,
    noisy,
    peak_rates,
    read,
    shrinking_ellipsoid,
)

from modalmotion.simulate import MotionClass

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
WIDEST, STRAINS = 6.0, ("gls", "gcs")


def _rows(mesh: str) -> Iterator[Row]:
    for name, (words, unit) in FIGURES.items():
        goal = GOALS.get(name, (None, None))[mesh != "16x32"]
        for noise in NOISES:
            text = f"{words} off by, {noise:g} mm of noise, {mesh}"
            yield Row(f"readouts.{mesh}.{name}.{noise:g}", text, unit, goal if noise <= 1 else None)
        text = f"{words} within its interval, noise of 0.6 to 1.5 mm, {mesh}"
        yield Row(f"readouts.{mesh}.{name}.inside", text, "%", goal=(92.0, 98.0))


def _measure(mesh: str, seed: int) -> tuple[float, ...]:
    found, true = [], []
    for clean, truth, rng in hearts(mesh, seed, 4):
        found.append([read(noisy(clean, noise, rng)) for noise in NOISES])
        true.append([[truth[name]] for name in FIGURES])
    stated = [[[of[name] for name in FIGURES] for of in of_heart] for of_heart in found]
    # Values and ends of intervals, each (figures, noises, hearts).
    (value, low, high), t = np.array(stated).T.copy(), np.moveaxis(np.array(true), 0, 2)
    is_share = np.array([[[unit == "%"]] for _, unit in FIGURES.values()])
    off = np.abs(value - t) * np.where(is_share, 100 / t, 1.0)
    inside = (low <= t) & (t <= high) & (is_share | (high - low <= WIDEST))
    shares = 100 * inside[:, 1:].mean(axis=(1, 2))
    return tuple(np.column_stack([off.mean(axis=2), shares]).ravel().tolist())


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
            one, other = (np.array([r[n][0] - t[n] for n in STRAINS]) for r, t in found)
            differences.append(float(np.abs(one - other).mean()))
    return tuple(float(np.mean(differences)) for differences in off.values())


@quick(
    Row("readouts.moved", "strain of a scaled, turned heart off", "points", 1e-9, "lower", 1e-12),
    Row("readouts.ellipsoid", "strain of ellipsoids off elliptic integrals by", "points", 0.1),
)
def laws(seed: int) -> tuple[float, float]:
    clean, _, rng = next(hearts("16x32", seed, 1))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    here, there = read(clean), read(replace(clean, vertices=1.7 * clean.vertices @ turn + 40.0))
    changed = max(abs(here[name][0] - there[name][0]) for name in STRAINS)
    off = []
    for beat, strains in (shrinking_ellipsoid(rng) for _ in range(10)):
        found = read(beat)
        off.append([abs(found[name][0] - true) for name, true in strains.items()])
    return changed, float(np.mean(off))


experiment(
    Row(
        "readouts.sdi.0", "dyssynchrony index of a late wall off by, 25 frames", "points", goal=0.5
    ),
    Row("readouts.sdi.1", "the same, 1 mm of noise", "points", goal=1.5),
    Row("readouts.sdi.inside", "index of a late wall within its interval", "%", goal=(92.0, 100.0)),
)(partial(dyssynchrony_of, (MotionClass.DYSSYNCHRONY,)))

experiment(
    Row("readouts.sdi.even.0", "dyssynchrony index of no late wall off by", "points", goal=0.5),
    Row("readouts.sdi.even.1", "the same, 1 mm of noise", "points", goal=1.5),
    Row("readouts.sdi.even.inside", "the same within its interval", "%", goal=(92.0, 100.0)),
)(partial(dyssynchrony_of, tuple(x for x in MotionClass if x != MotionClass.DYSSYNCHRONY)))

experiment(
    Row("readouts.phases.off", "held-out frames off, of straight lines' error", goal=0.5),
    Row("readouts.phases.inside", "held-out coordinates within two deviations", goal=(0.9, 0.98)),
)(held_out_phases)


@quick(
    Row("readouts.rates.16", "peak rates of 16 frames off by", "%", goal=1),
    Row("readouts.rates.41", "peak rates of 41 frames off by", "%", goal=0.5),
    Row("readouts.rates.inside", "peak rates within their bound", "%", goal=(92.0, 100.0)),
)
def rates(seed: int) -> tuple[float, ...]:
    off: dict[int, list[float]] = {16: [], 41: []}
    inside = []
    for n, value, bound, true in peak_rates(seed, tuple(off)):
        off[n].append(100 * abs(value - true) / true)
        inside.append(abs(value - true) <= bound)
    return (*(float(np.mean(each)) for each in off.values()), 100 * float(np.mean(inside)))
