"""Tracking beside others' methods, on one pair of frames of a real heart."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from judged_tracks import surface_distance
from measure import Table
from numpy.typing import NDArray
from real_data import is_there, recording
from seen_surfaces import Truth

from modalmotion.mesh import cavity_of
from modalmotion.tracking import Observation, of_surface, track

N_PEER = 1000
HEART = "heart/lv_endocardium"

Floats = NDArray[np.float64]


def run(_folder: Path) -> list[Table]:
    """Measure everything."""
    return [peers()] if is_there("tracking beside others", HEART) else []


def peers() -> Table:
    """One pair of frames, end diastole to end systole: others' best beside ours."""
    truth = Truth.of(recording(HEART))
    pair = Truth(truth.vertices[[0, int(truth.volumes.argmin())]], truth.faces, truth.ends)
    rng = np.random.default_rng(0)
    table = Table(
        f"One pair of frames, {N_PEER:,} points, 1 mm of noise",
        ("method", "surface mm", "EF off", "vertices mm", "s"),
    )
    frames = pair.seen(N_PEER, 1.0, rng)
    cloud = frames[1][0].points

    def add(name: str, x: Floats, seconds: float) -> None:
        mean = surface_distance(x, pair.faces, pair.vertices[1], pair.faces)
        v = np.abs(cavity_of(pair.faces, x.shape[0]).volume(np.stack([pair.vertices[0], x])))
        off = float(np.sqrt(((x - pair.vertices[1]) ** 2).sum(axis=1).mean()))
        fraction = 100 * (1 - v[1] / v[0]) - pair.ejection_fraction
        table.add(name, f"{mean:.3f}", f"{fraction:+.2f}", f"{off:.2f}", f"{seconds:.2f}")

    def ours(points: Sequence[Any], **more: Any) -> tuple[Floats, float]:
        result, seconds = timed(
            lambda: track(points, start=pair.start(), unit="mm", time="open", **more)
        )
        return result.sequence.vertices[1].astype(np.float64), seconds

    mine, own = ours(frames)
    add("ours", mine, own)
    foot, seconds = timed(
        lambda: cloud[np.linalg.norm(pair.vertices[0][:, None] - cloud, axis=2).argmin(axis=1)]
    )
    add("closest point, without a prior", foot, seconds)
    try:
        from pycpd import DeformableRegistration

        def register() -> Floats:
            found = DeformableRegistration(X=cloud, Y=pair.vertices[0], alpha=2, beta=20)
            return np.asarray(found.register()[0], dtype=np.float64)

        x, seconds = timed(register)
        add("pycpd", x, seconds)
        table.add_at_least(
            seconds / own, 20.0, "pycpd over ours, time", "", "", "", f"{seconds / own:.1f}"
        )
    except ModuleNotFoundError:
        table.add("pycpd", "not there", "", "", "")
    clean = pair.seen(N_PEER, 0.0, rng)
    mine, own = ours(clean)
    add("ours, clean points", mine, own)
    try:
        import trimesh

        def amberg() -> Floats:
            source = trimesh.Trimesh(pair.vertices[0], pair.faces, process=False)
            target = trimesh.Trimesh(pair.vertices[1], pair.faces, process=False)
            return np.asarray(trimesh.registration.nricp_amberg(source, target), dtype=np.float64)

        x, seconds = timed(amberg)
        add("trimesh nricp_amberg, the true mesh", x, seconds)
        theirs = surface_distance(x, pair.faces, pair.vertices[1], pair.faces)
        table.add_at_least(
            seconds / own, 10.0, "nricp_amberg over ours, time", "", "", "", f"{seconds / own:.1f}"
        )
        full = [
            [of_surface(y, pair.faces), Observation(y[pair.faces].mean(axis=1)), *marks[1:]]
            for y, marks in zip(pair.vertices, clean, strict=True)
        ]
        mine, seconds = ours(full, tolerance=theirs)
        add("ours, the true mesh, tolerance theirs", mine, seconds)
        mean = surface_distance(mine, pair.faces, pair.vertices[1], pair.faces)
        table.add_at_most(mean, theirs, "surface beside nricp_amberg's", f"{mean:.3f}", "", "", "")
    except ModuleNotFoundError:
        table.add("trimesh nricp_amberg", "not there", "", "", "")
    return table


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """Return the result of a call and its processor seconds."""
    start = time.process_time()
    result = call()
    return result, time.process_time() - start
