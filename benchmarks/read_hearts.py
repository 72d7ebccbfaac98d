"""Ventricles to read figures from, what is true of them, and what the product states."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import ellipe

import modalmotion as mm
from modalmotion.clinical.readouts import rates_of
from modalmotion.mesh import cavity_of
from modalmotion.simulate import Acquisition, MotionClass, draw_parameters, simulate_ventricle

Floats = NDArray[np.float64]

MESHES: Final[dict[str, dict[str, Any]]] = {
    "16x32": {"grid": (16, 32)},
    "32x64": {"grid": (32, 64)},
    "triangles": {"n_vertices": 2000},
}


def hearts(
    mesh: str, seed: int, n_per_class: int
) -> Iterator[tuple[mm.MeshSequence, dict[str, float], np.random.Generator]]:
    """Ventricles of all classes without noise, what is true of them, and what draws the noise.

    Strain of triangles is that of the same individual on a lattice which it converges on: each
    mesh is contracted to its own ejection fraction, which moves strain by 0.1 points.
    """
    frames = Acquisition(n_frames=12)
    for k, label in enumerate(list(MotionClass) * n_per_class):
        parameters = draw_parameters(label, np.random.default_rng([seed, k]))
        rng, again = (np.random.default_rng([seed, k, 1]) for _ in range(2))
        clean = simulate_ventricle(parameters, acquisition=frames, rng=rng, **MESHES[mesh])
        twin = clean
        if clean.grid is None:
            twin = simulate_ventricle(parameters, grid=(96, 192), acquisition=frames, rng=again)
        volumes = volumes_of(clean)
        ef = 100 * (1 - volumes.min() / volumes.max())
        yield clean, {"ef": ef, "edv": float(volumes.max()), **true_strain(twin)}, rng


def true_strain(clean: mm.MeshSequence) -> dict[str, float]:
    """Strain from end diastole to end systole, percent, of a cup lattice that follows the tissue.

    Written from the definitions of Voigt et al., Eur Heart J Cardiovasc Imaging, 2015, and of
    nothing else, so that the product's own strain is judged by it. "gls" is of lines from base to
    base through the apex, next to row 0, the mean of their lengths; "gcs" of the circumferences in
    the middles of three thirds of the lattice's rows, their mean; "gas" of the area.
    """
    assert clean.grid is not None
    rows, columns = clean.grid
    volumes, half = volumes_of(clean), columns // 2
    vertices = clean.vertices[[volumes.argmax(), volumes.argmin()]].astype(np.float64)
    x = vertices.reshape(2, rows, columns, 3)
    down = np.linalg.norm(np.diff(x, axis=1), axis=3).sum(axis=1)
    through = np.linalg.norm(x[:, 0, :half] - x[:, 0, half:], axis=2)
    lines = (down[:, :half] + down[:, half:] + through).mean(axis=1)
    rings = [_around(x, level * rows - 0.5) for level in (1 / 6, 1 / 2, 5 / 6)]
    a, b, c = (vertices[:, clean.faces[:, k]] for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=2).sum(axis=1) / 2.0
    gls, *levels, gas = (100.0 * (end / start - 1.0) for start, end in (lines, *rings, areas))
    return {"gls": float(gls), "gcs": float(np.mean(levels)), "gas": float(gas)}


def _around(x: NDArray[np.float64], row: float) -> NDArray[np.float64]:
    """Length of the line around at a row, or between two, (frames,)."""
    below, share = int(row), row % 1.0
    line = (1 - share) * x[:, below] + share * x[:, below + 1]
    lengths: NDArray[np.float64] = np.linalg.norm(line - np.roll(line, 1, axis=1), axis=2).sum(1)
    return lengths


def true_dyssynchrony(clean: mm.MeshSequence) -> float:
    """Deviation of the times of least volume of 16 segments, % of the cycle (Kapetanakis 2005).

    Parameters
    ----------
    clean : mm.MeshSequence
        A cup lattice of one cycle, in so many frames that they do not matter.
    """
    assert clean.grid is not None
    cap = 1 / 8  # of the wall, which the 17th segment has
    rows, columns = clean.grid
    x = clean.vertices.astype(np.float64).reshape(clean.n_frames, rows, columns, 3)
    middles = x.mean(axis=2, keepdims=True)
    sectors = np.cross(x - middles, np.roll(x, -1, axis=2) - middles) / 2.0
    pieces = (sectors * np.gradient(middles, axis=1)).sum(axis=3)
    heights = (np.arange(rows) + 0.5) / rows
    turn = (np.arange(columns) + 0.5) / columns
    times = []
    for ring, parts in enumerate((4, 6, 6)):
        low, high = cap + (1 - cap) * np.array([ring, ring + 1]) / 3
        within = (heights >= low) & (heights < high)
        for part in range(parts):
            own = pieces[:, within][:, :, np.floor(parts * turn) == part].sum(axis=(1, 2))
            times.append(float(np.abs(own).argmin()) / clean.n_frames)
    return float(100.0 * np.std(times, ddof=1))


def noisy(clean: mm.MeshSequence, noise: float, rng: np.random.Generator) -> mm.MeshSequence:
    return replace(clean, vertices=clean.vertices + rng.normal(0.0, noise, clean.vertices.shape))


def read(sequence: mm.MeshSequence) -> dict[str, tuple[float, float, float]]:
    """Each figure as the product states it, with the ends of its interval."""
    signature = mm.modal_signature(sequence)
    curve = mm.clinical_readouts(signature, sequence).curve
    strain = mm.strain(sequence)
    assert curve.share is not None
    assert curve.share_range is not None
    return {
        "ef": (curve.share, *curve.share_range),
        "edv": (curve.end_diastolic_volume, *curve.end_diastolic_range),
        **{name.lower(): strain.end_systolic[name] for name in ("GLS", "GCS", "GAS")},
    }


def peak_rates(
    seed: int, counts: tuple[int, ...], n_per_class: int = 4
) -> Iterator[tuple[int, float, float, float]]:
    """Frames of a beat, a peak rate as the product states it, its bound, and that of 600 frames."""
    for k, label in enumerate(list(MotionClass) * n_per_class):
        parameters = draw_parameters(label, np.random.default_rng([seed, k]))
        simulated = partial(simulate_ventricle, parameters, grid=(12, 24))
        finest, *beats = (
            simulated(acquisition=Acquisition(n_frames=n), rng=np.random.default_rng([seed, k, 1]))
            for n in (600, *counts)
        )
        volumes = volumes_of(finest)
        slopes = np.diff(volumes, append=volumes[0]) * 600 / parameters.period
        for n, beat in zip(counts, beats, strict=True):
            readouts = mm.clinical_readouts(mm.modal_signature(beat), beat)
            found = rates_of(readouts, parameters.period)
            yield n, found.peak_ejection_rate, found.ejection_bound, -slopes.min() / 1000
            yield n, found.peak_filling_rate, found.filling_bound, slopes.max() / 1000


def dyssynchrony_of(labels: tuple[MotionClass, ...], seed: int) -> tuple[float, ...]:
    """Errors of the dyssynchrony index, without noise and with 1 mm of it; % inside."""
    off: dict[float, list[float]] = {0.0: [], 1.0: []}
    inside = []
    for k in range(12):
        state = [seed, k]
        label = labels[k % len(labels)]
        parameters = draw_parameters(label, np.random.default_rng(state))
        simulated = partial(simulate_ventricle, parameters, grid=(24, 48))
        frames = (Acquisition(n_frames=n) for n in (400, 25))
        many, few = (simulated(acquisition=a, rng=np.random.default_rng(state)) for a in frames)
        true = true_dyssynchrony(many)
        for noise, errors in off.items():
            found = mm.strain(noisy(few, noise, np.random.default_rng(state))).dyssynchrony
            assert found is not None
            errors.append(abs(found.value - true))
            inside.append(found.low <= true <= found.high)
    return (*(float(np.mean(each)) for each in off.values()), 100 * float(np.mean(inside)))


def held_out_phases(seed: int) -> tuple[float, float]:
    """Error of frames held out over that of straight lines, and the share inside.

    Every second of 30 frames is held out, without noise and with 0.3 mm of it.
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


def volumes_of(clean: mm.MeshSequence) -> Floats:
    cavity = cavity_of(clean.faces, clean.n_vertices)
    return np.abs(cavity.volume(clean.vertices.astype(np.float64)))


def shrinking_ellipsoid(rng: np.random.Generator) -> tuple[mm.MeshSequence, dict[str, float]]:
    """Half an ellipsoid that shrinks by unequal shares, and its strain by elliptic integrals."""
    rest = rng.uniform((25, 20, 75), (30, 24, 85))
    short = rest * rng.uniform(0.7, 0.85, 3)
    axes = (np.arange(32) + 0.5) / 32 * np.pi / 2, 2 * np.pi * np.arange(64) / 64
    polar, around = (each.ravel() for each in np.meshgrid(*axes, indexing="ij"))
    across, down = np.sin(polar), -np.cos(polar)
    sphere = np.stack([across * np.cos(around), across * np.sin(around), down], axis=1)
    frames = np.stack([sphere * rest, sphere * short])
    facts = mm.Facts(tracking="material", cavity="lv")
    beat = mm.mesh_sequence(frames, grid=(32, 64), topology="cup", unit="mm", facts=facts)
    turns = 2 * np.pi * (np.arange(720) + 0.5) / 720
    before, after = (
        (_quarter(np.hypot(a * np.cos(turns), b * np.sin(turns)), c).mean(), _quarter(a, b))
        for a, b, c in (rest, short)
    )
    gls, gcs = (float(100 * (y / x - 1)) for x, y in zip(before, after, strict=True))
    return beat, {"gls": gls, "gcs": gcs}


def _quarter(a: Any, b: Any) -> Any:
    """Length of a quarter of an ellipse."""
    long, short = np.maximum(a, b), np.minimum(a, b)
    return long * ellipe(1 - (short / long) ** 2)
