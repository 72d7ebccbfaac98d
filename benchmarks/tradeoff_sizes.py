"""Seconds and memory of each basis on meshes of a thousand to a million vertices.

Each measurement has a process of its own, so that none inherits another's memory, with one thread,
and is ended after a while of the processor's time: what takes longer is reported as such. Small
meshes are measured several times, and the fastest counts.
"""

from __future__ import annotations

import importlib
import multiprocessing
import os
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from tradeoff_bases import BELTRAMI, CLOSED, PCA, ROOT, SPRINGS, beltrami_modes, displaced

from modalmotion.choice.fitter import Fitter
from modalmotion.fit.basis import make_basis
from modalmotion.mesh import vertex_areas
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.mesh.spring_modes import spring_modes
from modalmotion.template import choose_modes, make_template

N_MODES = 7
SIZES = (1_000, 10_000, 100_000, 1_000_000)
CAP_SECONDS = 60
LONGEST_WAIT = 2.5 * CAP_SECONDS
LATTICE = "closed form, lattice"
ORDER = (LATTICE, CLOSED, SPRINGS, BELTRAMI, PCA)
LATTICES = {1_000: (25, 40), 10_000: (100, 100), 100_000: (250, 400), 1_000_000: (1000, 1000)}
# Vertices of the coarse mesh, and how often each of its triangles is cut in four.
COARSE = {1_000: (1_000, 0), 10_000: (10_000, 0), 100_000: (6_250, 2), 1_000_000: (15_650, 3)}


@dataclass
class Cost:
    """What one basis took on one mesh.

    Parameters
    ----------
    n_vertices : int
    seconds : dict of str to float
        By stage; empty where the cap was met.
    megabytes : float
        Most memory above the sequence itself.
    rms : float, mm
    stopped : str
        Why there is nothing; empty otherwise.
    """

    n_vertices: int
    seconds: dict[str, float] = field(default_factory=dict)
    megabytes: float = float("nan")
    rms: float = float("nan")
    stopped: str = ""

    @property
    def total(self) -> float:
        """Seconds of all stages."""
        return sum(self.seconds.values()) if self.seconds else float("nan")


def costs(sizes: tuple[int, ...] = SIZES) -> dict[str, list[Cost]]:
    """Measure every basis on every size, smallest first."""
    found: dict[str, list[Cost]] = {name: [] for name in ORDER}
    with tempfile.TemporaryDirectory() as folder:
        for size in sizes:
            for name in ORDER:
                previous = found[name][-1] if found[name] else None
                # Ten times the vertices take ten times as long at the very least.
                if previous is not None and (previous.stopped or 10 * previous.total > CAP_SECONDS):
                    cost = Cost(size, stopped="not run")
                else:
                    path = _written(Path(folder), size, lattice=name == LATTICE)
                    cost = _alone(name, path, size)
                found[name].append(cost)
                note = cost.stopped or f"{cost.total:.2f} s, {cost.megabytes:.0f} MB"
                print(f"  {size:>9,} {name:<22} {note}", flush=True)
            for path in Path(folder).iterdir():
                path.unlink()
    return found


def _alone(name: str, path: Path, size: int) -> Cost:
    """Run a measurement in a process of its own, for as long as the cap allows."""
    # Read by the linear algebra of the process to come.
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(there, name, path))
    process.start()
    there.close()
    try:
        if not here.poll(LONGEST_WAIT):
            return Cost(size, stopped=f"> {CAP_SECONDS} s")
        cost: Cost = here.recv()
    except EOFError:
        process.join()
        ended = process.exitcode == -signal.SIGXCPU
        return Cost(size, stopped=f"> {CAP_SECONDS} s" if ended else "out of memory")
    else:
        return cost
    finally:
        process.kill()
        process.join()


def _send(there: Connection, name: str, path: Path) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (CAP_SECONDS, CAP_SECONDS + 5))
    there.send(_measure(name, _loaded(path)))


def _measure(name: str, sequence: MeshSequence) -> Cost:
    n_times = max(1, min(5, 200_000 // sequence.n_vertices))
    found = [_measure_once(name, sequence) for _ in range(n_times)]
    fastest = min(found, key=lambda cost: cost.total)
    # The first one meets memory that nobody has used yet.
    return replace(fastest, megabytes=found[0].megabytes)


def _measure_once(name: str, sequence: MeshSequence) -> Cost:
    _forget_peak()
    before = _peak_megabytes()
    seconds: dict[str, float] = {}
    clock = time.perf_counter()

    def stage(label: str) -> None:
        nonlocal clock
        now = time.perf_counter()
        seconds[label], clock = now - clock, now

    if name in (LATTICE, CLOSED):
        template = make_template(sequence)
        stage("coordinates")
        basis = make_basis(template, choose_modes(template, N_MODES, sequence.grid).modes)
        stage("modes")
        fit = Fitter.of(sequence, template).fit(basis)
        stage("fit")
        rms = float(np.sqrt((fit.errors.weighted_rms**2).mean()))
    else:
        rms = _by_own_basis(name, sequence, stage)
    return Cost(sequence.n_vertices, seconds, _peak_megabytes() - before, rms)


def _by_own_basis(name: str, sequence: MeshSequence, stage: Callable[[str], None]) -> float:
    areas = vertex_areas(sequence.vertices[0].astype(np.float64), sequence.faces)
    weights = areas / areas.sum()
    root = np.sqrt(weights)[:, None]
    if name == PCA:
        frames = root * displaced(sequence, weights)
        flat = frames.reshape(sequence.n_frames, -1)
        squares = np.linalg.eigvalsh(flat @ flat.T / sequence.n_frames)
        stage("modes")
        return float(np.sqrt(max(0.0, squares[:-N_MODES].sum())))
    if name == SPRINGS:
        shapes = spring_modes(sequence.faces, sequence.n_vertices, N_MODES).shapes
    else:
        shapes = beltrami_modes(sequence, N_MODES)
    stage("modes")
    Q, _ = np.linalg.qr(root * shapes)
    left = 0.0
    for frame in displaced(sequence, weights):
        weighted = root * frame
        left += float(((weighted - Q @ (Q.T @ weighted)) ** 2).sum())
    stage("fit")
    return float(np.sqrt(left / sequence.n_frames))


def _written(folder: Path, size: int, *, lattice: bool) -> Path:
    """Write a beating cup of about so many vertices, 12 frames, as float32."""
    path = folder / f"{size}-{'lattice' if lattice else 'mesh'}.npz"
    if path.exists():
        return path
    sys.path.insert(0, str(ROOT / "tests" / "support"))
    made = importlib.import_module("template_surfaces")
    remeshing = importlib.import_module("template_remeshing")
    if lattice:
        rows, columns = LATTICES[size]
        polar = np.arccos(-0.35) * (np.arange(rows) + 0.5) / rows
        turn = 2 * np.pi * np.arange(columns) / columns
        r, z = np.sin(polar)[:, None], -np.cos(polar)[:, None]
        ball = [r * np.cos(turn), r * np.sin(turn), z + 0 * turn]
        points = np.stack(ball, axis=-1).reshape(-1, 3)
        np.savez(path, vertices=made.ventricle(points).astype(np.float32), grid=(rows, columns))
        return path
    n, times = COARSE[size]
    moving = made.make_ventricle(n, np.random.default_rng(0))
    for _ in range(times):
        moving = remeshing.subdivided(moving)
    np.savez(path, vertices=moving[0].astype(np.float32), faces=moving[1])
    return path


def _loaded(path: Path) -> MeshSequence:
    with np.load(path) as arrays:
        if "grid" in arrays:
            return mesh_sequence(arrays["vertices"], grid=arrays["grid"], topology="cup", unit="mm")
        return mesh_sequence(arrays["vertices"], arrays["faces"], unit="mm")


def _forget_peak() -> None:
    """Let the peak of memory count from here, where the system allows it."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak_megabytes() -> float:
    """Most memory this process has held, where the system says it; else not a number."""
    status = Path("/proc/self/status")
    if not status.exists():
        return np.nan
    line = next(x for x in status.read_text().splitlines() if x.startswith("VmHWM"))
    return int(line.split()[1]) * 1024 / 1e6
