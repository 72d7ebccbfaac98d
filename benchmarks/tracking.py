"""Tracking without correspondence: real clouds and contours, stated deviations, peers, time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from measure import Table
from numpy.typing import NDArray
from real_data import is_there, recording
from tracking_contours import real_contours, simulated_contours
from tracking_peers import HEART, peers
from tracking_truth import Score, Truth, timed

from modalmotion.classification import classify, load_model
from modalmotion.classification.model.shipped import OFFSET_MODEL
from modalmotion.facts import Facts
from modalmotion.mesh.normal_lines import vertex_normals
from modalmotion.mesh.standard_surfaces import standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topology import SPHERE
from modalmotion.signature.making import SignatureKind, SignatureParameters, modal_signature
from modalmotion.simulate import simulate_cohort
from modalmotion.tracking import Observation, Track, of_surface, track

N_POINTS = 2000
N_VENTRICLES = 200
N_OF_EACH_CLASS = 10

Floats = NDArray[np.float64]
Frames = Sequence[Sequence[Observation]]


def run(_folder: Path) -> list[Table]:
    """Measure everything."""
    tables = [
        simulated_contours(),
        closed(),
        stated(N_VENTRICLES),
        classes(N_OF_EACH_CLASS),
    ]
    if is_there("tracking: a real heart", HEART):
        tables = [clouds(), remeshed(), peers(), *tables]
        if is_there("tracking: real contours", "cine/contours"):
            tables.append(real_contours())
    return tables


def clouds() -> Table:
    truth = Truth.of(recording(HEART))
    table = Table(
        f"Real left ventricle, {N_POINTS:,} points a frame and 3 landmarks, 37 modes",
        ("data", "figure", "value"),
    )
    clean: Score | None = None
    for name, noise, strays, bounds in (
        ("clean", 0.0, 0.0, (0.20, 0.7, 0.5, 1.7)),
        ("noise 1 mm", 1.0, 0.0, (0.25, 0.8, 0.8, 1.9)),
        ("noise 1 mm, 30 % strays", 1.0, 0.3, None),
    ):
        frames = truth.seen(N_POINTS, noise, np.random.default_rng(0), strays)
        result, seconds = timed(partial(track, frames, start=truth.start(), unit="mm"))
        score = Score.of(result, truth)
        values = (score.mean, score.hausdorff, abs(score.fraction), score.vertices)
        names = ("surface, mean mm", "surface, 95 % mm", "EF off, points", "vertices, RMS mm")
        for k, (figure, value) in enumerate(zip(names, values, strict=True)):
            if bounds is not None:
                table.add_at_most(value, bounds[k], name, figure, f"{value:.3f}")
            elif k == 0 and clean is not None:
                table.add_at_most(
                    value / clean.mean,
                    1.2,
                    name,
                    "mean over that without",
                    f"{value / clean.mean:.3f}",
                )
            else:
                table.add(name, figure, f"{value:.3f}")
        bound = result.ejection_fraction_bound or 0.0
        table.add(name, "EF bound stated, points", f"{bound:.2f}")
        table.add_at_most(
            seconds / len(frames), 0.2, name, "s a frame", f"{seconds / len(frames):.3f}"
        )
        clean = score
    return table


def remeshed() -> Table:
    """Each frame has other vertices and other triangles."""
    sequence = recording(HEART)
    truth, rng = Truth.of(sequence), np.random.default_rng(1)
    frames = []
    for x, marks in zip(truth.vertices, truth.seen(10, 0.0, rng), strict=True):
        # Other vertices: centroids; other triangles: around them, their places drawn anew.
        middles = x[truth.faces].mean(axis=1)
        order = rng.permutation(len(middles))
        frames.append([Observation(middles[order]), of_surface(x, truth.faces), *marks[1:]])
    result = track(frames, start=truth.start(), unit="mm")
    parameters = SignatureParameters(kind=SignatureKind.OFFSET)
    own = modal_signature(sequence, parameters).amplitudes
    found = modal_signature(result.sequence, parameters).amplitudes
    off = float(np.linalg.norm(found - own) / np.linalg.norm(own))
    table = Table("Remeshed in every frame", ("figure", "value"))
    table.add_at_most(off, 0.05, "offset signature, relative", f"{off:.4f}")
    return table


def closed() -> Table:
    scores = [Score.of(track(t.seen(1500, 0.7, rng), unit="mm"), t) for t, rng in _closed(8)]
    means = np.array([s.mean for s in scores])
    fractions = np.abs([s.fraction for s in scores])
    table = Table(f"{len(scores)} closed surfaces, noise 0.7 mm, no landmarks", ("figure", "value"))
    table.add_at_most(float(np.median(means)), 0.3, "surface, median mm", f"{np.median(means):.3f}")
    table.add_at_most(float(means.max()), 0.6, "surface, worst mm", f"{means.max():.3f}")
    table.add_at_most(float(np.median(fractions)), 1.0, "EF, median", f"{np.median(fractions):.2f}")
    table.add_at_most(float(fractions.max()), 2.0, "EF, worst", f"{fractions.max():.2f}")
    return table


def stated(n_ventricles: int) -> Table:
    """Share of errors within the stated deviations, pooled over vertices, frames and cases."""
    across, along, names = [], [], []
    for name, truth, rng in (*_ventricles(n_ventricles), *_beyond()):
        noise = float(rng.choice([0.0, 0.5, 1.0]))
        frames = truth.seen(N_POINTS, noise, rng)
        result = track(frames, start=truth.start(), unit="mm")
        n_shares = _shares(result, truth)
        names.append(name)
        across.append(n_shares[0])
        along.append(n_shares[1])
    table = Table(f"Stated deviations, {len(names)} cases", ("", "68 %", "95 %", "worst tenth"))
    for name, cases in (("across the surface", across), ("along it", along)):
        pooled = np.concatenate(cases)
        own = np.array([(z < 1.0).mean() for z in cases])
        one, two = float((pooled < 1.0).mean()), float((pooled < 1.96).mean())
        worst = f"{np.quantile(own, 0.1):.0%} to {np.quantile(own, 0.9):.0%}"
        table.add_at_most(abs(one - 0.68), 0.08, name, f"{one:.1%}", "", worst)
        table.add_at_least(two, 0.90, name, "", f"{two:.1%}", "")
    return table


def classes(n_of_each: int) -> Table:
    """Classes that the model of offsets names for a ventricle's mesh, and for its noisy cloud."""
    model, same, right = load_model(OFFSET_MODEL), [], []
    for k, case in enumerate(
        simulate_cohort(n_of_each, rng=np.random.default_rng(1234), noise=0.0)
    ):
        if str(case.label) not in model.classes:
            continue
        mesh = replace(case.sequence, times=None)
        start = replace(mesh, vertices=mesh.vertices[:1])
        clouds = Truth.of(mesh).seen(N_POINTS, 1.0, np.random.default_rng(1234 + k))
        found = track(clouds, start=start, unit="mm").sequence
        both = [
            classify(sequence.with_facts(Facts(tracking="offset")), model).label
            for sequence in (mesh, found)
        ]
        if None not in both:
            same.append(both[0] == both[1])
            right.append([label == case.label for label in both])
    table = Table(f"Classes of {len(same)} ventricles, mesh and cloud", ("figure", "value"))
    share = float(np.mean(same))
    table.add_at_least(share, 0.97, "mesh and cloud are of the same class", f"{share:.1%}")
    of_mesh, of_cloud = np.mean(right, axis=0)
    table.add("right of meshes, of clouds", f"{of_mesh:.1%}, {of_cloud:.1%}")
    return table


def _shares(result: Track, truth: Truth) -> tuple[Floats, Floats]:
    """Errors over stated deviations, across and along the surface."""
    across, along = [], []
    for x, found, sd in zip(
        truth.vertices, result.sequence.vertices, result.deviations, strict=True
    ):
        if not sd.any():
            continue
        n = vertex_normals(found.astype(np.float64), truth.faces)
        first = np.cross(n, np.eye(3)[np.abs(n).argmin(axis=1)])
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        error = found - x
        across.append(np.abs((error * n).sum(axis=1)) / sd[:, 0])
        along += [np.abs((error * t).sum(axis=1)) / sd[:, 1] for t in (first, np.cross(n, first))]
    return np.concatenate(across), np.concatenate(along)


def _ventricles(n: int) -> Iterator[tuple[str, Truth, np.random.Generator]]:
    """Simulate ventricles of all classes, every third frame."""
    cohort = simulate_cohort(-(-n // 5), rng=np.random.default_rng(2024), noise=0.0)
    for k, case in enumerate(cohort):
        if k < n:
            full = Truth.of(case.sequence)
            yield (
                str(case.label),
                Truth(full.vertices[::3], full.faces, full.ends),
                np.random.default_rng(k),
            )


def _closed(n: int) -> Iterator[tuple[Truth, np.random.Generator]]:
    """Make spheroids and bent crescents that contract unevenly."""
    base = standard_surface(Lattice(SPHERE, (40, 60)))
    for k in range(n):
        rng = np.random.default_rng(k)
        x = base.vertices[0] * np.array([25.0, 22.0, 40.0]) * rng.uniform(0.8, 1.2, 3)
        if k % 2:
            x[:, 0] += rng.uniform(0.008, 0.015) * x[:, 2] ** 2
            x[:, 1] *= 0.7
        turn, frames = rng.uniform(0, 7), []
        for phase in np.arange(16) / 16:
            c = 0.5 - 0.5 * np.cos(2 * np.pi * phase)
            s = 1 - 0.18 * c * (1 + 0.3 * np.cos(np.arctan2(x[:, 1], x[:, 0]) + turn))
            frames.append(x * np.stack([s, s, 1 - 0.1 * c + 0 * s], axis=1))
        yield Truth(np.stack(frames), base.faces, ()), rng


def _beyond() -> Iterator[tuple[str, Truth, np.random.Generator]]:
    """Make closed surfaces, and ventricles with motion that 37 modes cannot hold."""
    for truth, rng in _closed(10):
        yield "closed", truth, rng
    cohort = simulate_cohort(2, rng=np.random.default_rng(99), noise=0.0)
    for k, case in enumerate(cohort):
        rng, full = np.random.default_rng(1000 + k), Truth.of(case.sequence)
        x = full.vertices[::3]
        n = vertex_normals(x[0], full.faces)
        place = x[0][rng.integers(x.shape[1])]
        bump = np.exp(-((x[0] - place) ** 2).sum(axis=1) / 2 / 6.0**2)
        phase = np.sin(np.pi * np.arange(len(x)) / len(x))
        dented = x - 4.0 * phase[:, None, None] * bump[:, None] * n
        yield "dent", Truth(dented, full.faces, full.ends), rng
