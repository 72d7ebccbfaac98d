"""Rows of the table of truth: volumes, rates and strain of simulated ventricles.

Strain of the area and the dyssynchrony index have no rows yet: they come with the read-outs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from experiments import Row, experiment
from numpy.typing import NDArray
from scipy.special import ellipe
from strain_truth import StrainTruth, fine_twin, strain_truth

import modalmotion as mm
from modalmotion.clinical.rates import rates_of
from modalmotion.clinical.strain import wall_strain
from modalmotion.mesh import cavity_of
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.simulate import Acquisition, MotionClass, draw_parameters, simulate_ventricle

NOISES = (0.0, 0.6, 1.0, 1.5)
MESHES: dict[str, dict[str, Any]] = {
    "16x32": {"grid": (16, 32)},
    "32x64": {"grid": (32, 64)},
    "triangles": {"n_vertices": 2000},
}
FIGURES = {
    "ef": ("ejection fraction", "points"),
    "edv": ("end-diastolic volume", "%"),
    "gls": ("longitudinal strain", "points"),
    "gcs": ("circumferential strain", "points"),
}
# Mean absolute errors at 1 mm of noise or less, coarse mesh and others.
GOALS = {"gls": (0.6, 0.4), "gcs": (0.9, 0.6)}
N_PER_CLASS = 6
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
    for clean, truth, rng in _hearts(mesh, seed, N_PER_CLASS):
        true = _true(clean, truth)
        for noise in NOISES:
            found = _read(_noisy(clean, noise, rng))
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
def meshes(seed: int) -> tuple[float, float]:
    """Beyond what the truth on both differs by, for each is contracted to its own volume."""
    off: dict[float, list[float]] = {0.0: [], 1.0: []}
    pairs = zip(_hearts("16x32", seed, 2), _hearts("32x64", seed, 2), strict=True)
    for pair in pairs:
        for noise, differences in off.items():
            found = [(_read(_noisy(heart, noise, rng)), truth) for heart, truth, rng in pair]
            one, other = (
                np.array([read["gls"][0] - truth.gls, read["gcs"][0] - truth.gcs])
                for read, truth in found
            )
            differences.append(float(np.abs(one - other).mean()))
    return float(np.mean(off[0.0])), float(np.mean(off[1.0]))


@experiment(
    Row("readouts.moved", "strain changes by scaling and rigid motion by", "points", 1e-9),
    Row("readouts.ellipsoid", "strain of an ellipsoid off elliptic integrals by", "points", 0.1),
    quick=True,
)
def laws(seed: int) -> tuple[float, float]:
    clean, _, rng = next(_hearts("16x32", seed, 1))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    moved = replace(clean, vertices=1.7 * clean.vertices @ turn + 40.0)
    here, there = _read(clean), _read(moved)
    changed = max(abs(here[name][0] - there[name][0]) for name in ("gls", "gcs"))
    rest = rng.uniform((25, 20, 75), (30, 24, 85))
    short = rest * rng.uniform(0.7, 0.85, 3)
    sphere = _half_sphere(32, 64)
    beat = mm.mesh_sequence(
        np.stack([sphere * rest, sphere * short]),
        grid=(32, 64),
        topology="cup",
        unit="mm",
        facts=clean.facts,
    )
    found = _read(beat)
    off = (
        abs(found[name][0] - 100 * (length(short) / length(rest) - 1))
        for name, length in (("gls", _meridian), ("gcs", _equator))
    )
    return changed, max(off)


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
        volumes = _volumes(beats[600])
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


def _hearts(
    mesh: str, seed: int, n_per_class: int
) -> Iterator[tuple[MeshSequence, StrainTruth, np.random.Generator]]:
    """Ventricles of all classes without noise, what is true of them, and what draws the noise."""
    frames = Acquisition(n_frames=12)
    for k, label in enumerate(list(MotionClass) * n_per_class):
        parameters, state = draw_parameters(label, np.random.default_rng([seed, k])), [seed, k, 1]
        rng = np.random.default_rng(state)
        clean = simulate_ventricle(parameters, acquisition=frames, rng=rng, **MESHES[mesh])
        twin = clean if clean.grid else fine_twin(parameters, state, frames)
        yield clean, strain_truth(twin), rng


def _true(clean: MeshSequence, truth: StrainTruth) -> dict[str, float]:
    volumes = _volumes(clean)
    share = 100 * (1 - volumes.min() / volumes.max())
    return {"ef": share, "edv": float(volumes.max()), "gls": truth.gls, "gcs": truth.gcs}


def _noisy(clean: MeshSequence, noise: float, rng: np.random.Generator) -> MeshSequence:
    return replace(clean, vertices=clean.vertices + rng.normal(0.0, noise, clean.vertices.shape))


def _read(sequence: MeshSequence) -> dict[str, tuple[float, float, float]]:
    """Each figure as the product states it, with the ends of its interval."""
    signature = mm.modal_signature(sequence)
    curve = mm.clinical_readouts(signature, sequence).curve
    strain = wall_strain(signature, sequence, curve.end_diastole)
    around, along = (
        (value, value - bound, value + bound)
        for value, bound in zip(
            strain.whole[curve.end_systole], strain.whole_bounds[curve.end_systole], strict=True
        )
    )
    assert curve.share is not None
    assert curve.share_range is not None
    return {
        "ef": (curve.share, *curve.share_range),
        "edv": (curve.end_diastolic_volume, *curve.end_diastolic_range),
        "gls": along,
        "gcs": around,
    }


def _volumes(clean: MeshSequence) -> NDArray[np.float64]:
    cavity = cavity_of(clean.faces, clean.n_vertices)
    return np.abs(cavity.volume(clean.vertices.astype(np.float64)))


def _half_sphere(rows: int, columns: int) -> NDArray[np.float64]:
    polar = (np.arange(rows) + 0.5) / rows * np.pi / 2
    around = 2 * np.pi * np.arange(columns) / columns
    rings = np.stack([np.cos(around), np.sin(around), np.zeros(columns)], axis=1)
    heights = np.array([0.0, 0.0, -1.0])
    nodes = np.sin(polar)[:, None, None] * rings + np.cos(polar)[:, None, None] * heights
    return np.asarray(nodes.reshape(-1, 3))


def _meridian(axes: NDArray[np.float64]) -> float:
    """Mean length of quarter ellipses from the apex of an ellipsoid to its equator."""
    turns = 2 * np.pi * (np.arange(720) + 0.5) / 720
    r = np.hypot(axes[0] * np.cos(turns), axes[1] * np.sin(turns))
    long, short = np.maximum(r, axes[2]), np.minimum(r, axes[2])
    return float((long * ellipe(1 - (short / long) ** 2)).mean())


def _equator(axes: NDArray[np.float64]) -> float:
    short, long = sorted(axes[:2])
    return float(4 * long * ellipe(1 - (short / long) ** 2))
