"""Tracking beside others' methods, on one pair of frames of a real heart."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from importlib import import_module

import numpy as np
from judged_tracks import surface_distance
from measure import table
from numpy.typing import NDArray
from real_data import is_there, recording
from seen_surfaces import Truth

from modalmotion.mesh import cavity_of
from modalmotion.tracking import track

N_PEER = 1000
HEART = "heart/lv_endocardium"

Floats = NDArray[np.float64]


def run() -> Iterator[str]:
    """One pair of frames, end diastole to end systole: others' best beside ours."""
    if not is_there("tracking beside others", HEART):
        return
    truth, rng = Truth.of(recording(HEART)), np.random.default_rng(0)
    pair = Truth(truth.vertices[[0, int(truth.volumes.argmin())]], truth.faces, truth.ends)
    (before, after), faces = pair.vertices, pair.faces
    frames = pair.seen(N_PEER, 1.0, rng)
    cloud = frames[1][0].points

    def ours() -> Floats:
        result = track(frames, start=pair.start(), unit="mm", time="open")
        return np.asarray(result.sequence.vertices[1], dtype=np.float64)

    def closest() -> Floats:
        return np.asarray(cloud[np.linalg.norm(before[:, None] - cloud, axis=2).argmin(axis=1)])

    def pycpd() -> Floats:
        made = import_module("pycpd").DeformableRegistration(X=cloud, Y=before, alpha=2, beta=20)
        return np.asarray(made.register()[0], dtype=np.float64)

    calls: dict[str, Callable[[], Floats]] = {
        "ours": ours,
        "closest point, without a prior": closest,
        "pycpd": pycpd,
    }
    rows = []
    for name, call in calls.items():
        start = time.process_time()
        try:
            x = call()
        except ModuleNotFoundError as missing:
            rows.append((name, f"{missing.name} is not installed", "", "", ""))
            continue
        seconds = time.process_time() - start
        v = np.abs(cavity_of(faces, len(x)).volume(np.stack([before, x])))
        off = float(np.sqrt(((x - after) ** 2).sum(axis=1).mean()))
        fraction = 100 * (1 - v[1] / v[0]) - pair.ejection_fraction
        mean = surface_distance(x, faces, after, faces)
        rows.append((name, f"{mean:.3f}", f"{fraction:+.2f}", f"{off:.2f}", f"{seconds:.2f}"))
    title = f"One pair of frames, {N_PEER:,} points, 1 mm of noise"
    yield table(title, ["method", "surface mm", "EF off", "vertices mm", "s"], rows)
