"""A cohort on one and on two workers, what a batch saves, and what a sequence costs."""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from cluster_processes import Cluster, ProcessorSeconds, processor_seconds, running_cluster
from measure import Table, in_words

from modalmotion.formats import read_sequence, write_npz
from modalmotion.formats.parser.registry import ParserHere
from modalmotion.limits import DEFAULT_LIMITS
from modalmotion.signature.making import modal_signature
from modalmotion.simulate import Acquisition, MotionClass, simulate_cohort, simulate_ventricle
from modalmotion.store import sequence_to_hdf5, signature_to_hdf5
from modalmotion_service.cohort import CohortJob, read_manifest, sign_cohort
from modalmotion_service.work.dask.executor import DaskExecutor
from modalmotion_service.work.executor import Engine
from modalmotion_service.work.pool import WorkerPool

N_SEQUENCES = int(os.environ.get("MODALMOTION_BENCH_SEQUENCES", "500"))
N_ROUNDS = int(os.environ.get("MODALMOTION_BENCH_ROUNDS", "3"))
LEAST_RATIO = 1.7
_LIMITS = (300.0, 6_000_000_000)


def run(_folder: Path | None = None) -> list[Table]:
    """Give the tables."""
    os.environ["OMP_NUM_THREADS"] = "1"
    with tempfile.TemporaryDirectory() as name:
        cohort = Path(name) / "cohort"
        cohort.mkdir()
        n_each = -(-N_SEQUENCES // len(MotionClass))
        cases = simulate_cohort(n_each, rng=np.random.default_rng(10))
        for number, case in zip(range(N_SEQUENCES), cases, strict=False):
            (cohort / f"{number:06d}.npz").write_bytes(write_npz(case.sequence))
        job = CohortJob(read_manifest(cohort), Path(name) / "out")
        with (
            running_cluster(1, Path(name)) as one,
            running_cluster(2, Path(name)) as two,
        ):
            engines = {
                "Dask, 1 worker": _Where(lambda at: DaskExecutor(one.address, at, *_LIMITS), one),
                "Dask, 2 workers": _Where(lambda at: DaskExecutor(two.address, at, *_LIMITS), two),
                "pool, 1 process": _Where(lambda _: WorkerPool(1, *_LIMITS), None),
                "pool, 2 processes": _Where(lambda _: WorkerPool(2, *_LIMITS), None),
            }
            return [*_scaling(job, engines), _batches(job, engines["Dask, 2 workers"]), _costs()]


@dataclass(frozen=True)
class _Where:
    open_engine: Callable[[Path], Engine]
    cluster: Cluster | None


@dataclass(frozen=True)
class _Took:
    seconds: float
    processor: ProcessorSeconds


def _took(job: CohortJob, where: _Where) -> _Took:
    """Run a cohort in a new folder, and time it from when the workers' processes are there.

    Processor times are those up to the last result: processes of a pool end with it.
    """
    started: list[_Took] = []
    done: list[ProcessorSeconds] = []

    def open_warm(folder: Path) -> Engine:
        engine = where.open_engine(folder)
        for future in [engine.submit(time.sleep, 0.2) for _ in range(2 * engine.n_workers)]:
            future.result()
        started.append(_Took(time.perf_counter(), processor_seconds(where.cluster)))
        return engine

    def progress(n_done: int, n_files: int) -> None:
        if n_done == n_files:
            done.append(processor_seconds(where.cluster))

    with tempfile.TemporaryDirectory() as name:
        report = sign_cohort(replace(job, folder=Path(name) / "out"), open_warm, progress)
        seconds = time.perf_counter() - started[0].seconds
    assert report.n_made == len(job.entries)
    return _Took(seconds, done[0].since(started[0].processor))


def _scaling(job: CohortJob, engines: dict[str, _Where]) -> tuple[Table, Table]:
    n = len(job.entries)
    walls = Table(
        f"A cohort of {n} simulated ventricles (medians and least of {N_ROUNDS}, in turn)",
        ("work", "seconds", "a sequence", "against one", "least", "against one"),
    )
    parts = Table(
        "Processor seconds of the same (medians), and what two free cores would make of them",
        ("work", "coordinator", "scheduler", "workers", "in all", "against one"),
    )
    samples: dict[str, list[_Took]] = {name: [] for name in engines}
    plain: list[float] = []
    for _ in range(N_ROUNDS):
        for name, where in engines.items():
            samples[name].append(_took(job, where))
        plain.append(2 * _plain(1) / _plain(2))
    for name, runs in samples.items():
        alone = next(other for other in engines if other.split(",")[0] == name.split(",")[0])
        seconds, first = _median(runs, _wall), _median(samples[alone], _wall)
        least, first_least = min(map(_wall, runs)), min(map(_wall, samples[alone]))
        cells = (name, f"{seconds:.2f}", in_words(seconds / n))
        whole = _median(runs, _all)
        # One worker goes beside the coordinator; with two there are three for two cores.
        bound = _median(samples[alone], _workers) / max(whole / 2, _median(runs, _workers) / 2)
        each = (_median(runs, part) for part in (_coordinator, _scheduler, _workers))
        times = (name, *(f"{value:.2f}" for value in each), f"{whole:.2f}")
        if name == alone:
            walls.add(*cells, "", f"{least:.2f}", "")
            parts.add(*times, "")
            continue
        ratios = (f"{first / seconds:.2f}", f"{least:.2f}", f"{first_least / least:.2f}")
        parts.add(*times, f"{bound:.2f}")
        if "Dask" in name:
            walls.add_at_least(first / seconds, LEAST_RATIO, *cells, *ratios)
        else:
            walls.add(*cells, *ratios)
    walls.add(
        *("two plain processes that only count", "", "", f"{statistics.median(plain):.2f}"),
        *("", f"{max(plain):.2f}"),
    )
    return walls, parts


def _median(runs: list[_Took], part: Callable[[_Took], float]) -> float:
    return statistics.median(map(part, runs))


def _wall(run: _Took) -> float:
    return run.seconds


def _coordinator(run: _Took) -> float:
    return run.processor.coordinator


def _scheduler(run: _Took) -> float:
    return run.processor.scheduler


def _workers(run: _Took) -> float:
    return run.processor.workers


def _all(run: _Took) -> float:
    return _coordinator(run) + _scheduler(run) + _workers(run)


def _plain(n: int) -> float:
    """Seconds that n processes need for the same counting each: what the cores give."""
    with ProcessPoolExecutor(n, mp_context=get_context("spawn")) as pool:
        list(pool.map(_count, [10] * n))
        start = time.perf_counter()
        list(pool.map(_count, [20_000_000] * n))
        return time.perf_counter() - start


def _count(n: int) -> int:
    total = 0
    for number in range(n):
        total += number
    return total


def _batches(job: CohortJob, where: _Where) -> Table:
    table = Table(
        f"Files in one piece of work, {len(job.entries)} sequences on Dask's 2 workers",
        ("files", "seconds", "a sequence"),
    )
    for size in (1, 2, 4, 8, 16, 32):
        times = [_took(replace(job, batch=size), where).seconds for _ in range(N_ROUNDS)]
        seconds = statistics.median(times)
        table.add(str(size), f"{seconds:.2f}", in_words(seconds / len(job.entries)))
    return table


def _costs() -> Table:
    table = Table(
        "One sequence of 25 frames, 21 amplitudes: processor time and bytes",
        ("sequence", "read", "fit", "both images", "npz", "vertices", "signature"),
    )
    rng = np.random.default_rng(2)
    beat = Acquisition(n_frames=25, noise=0.3)
    cases = {
        "lattice 32 x 64": simulate_ventricle(acquisition=beat, rng=rng),
        **{
            f"mesh of {n:,} vertices": simulate_ventricle(n_vertices=n, acquisition=beat, rng=rng)
            for n in (1_500, 4_000, 20_000)
        },
    }
    for name, sequence in cases.items():
        data = write_npz(sequence)
        parser = ParserHere(DEFAULT_LIMITS)
        signature = modal_signature(sequence)
        images = sequence_to_hdf5(sequence), signature_to_hdf5(signature)
        read = _processor_seconds(partial(read_sequence, data, parser=parser))
        fit = _processor_seconds(partial(modal_signature, sequence))
        image = _processor_seconds(partial(sequence_to_hdf5, sequence))
        image += _processor_seconds(partial(signature_to_hdf5, signature))
        sizes = (len(data), *map(len, images))
        table.add(name, *map(in_words, (read, fit, image)), *(f"{n / 1e3:,.0f} kB" for n in sizes))
    return table


def _processor_seconds(call: Callable[[], object], n: int = 5) -> float:
    times = []
    for _ in range(n):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return statistics.median(times)
