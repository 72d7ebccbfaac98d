"""A cohort on one and on two workers, what a batch saves, and what a sequence costs."""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from measure import Table, in_words

from modalmotion.formats import read_sequence, write_npz
from modalmotion.formats.limits import DEFAULT_LIMITS
from modalmotion.formats.parser_tasks import ParserHere
from modalmotion.signature import modal_signature
from modalmotion.simulate import Acquisition, MotionClass, simulate_cohort, simulate_ventricle
from modalmotion.store import sequence_to_hdf5, signature_to_hdf5
from modalmotion_service.cohort import CohortJob, read_manifest, sign_cohort
from modalmotion_service.dask_executor import DaskExecutor
from modalmotion_service.executor import Engine, WorkerPool

N_SEQUENCES = int(os.environ.get("MODALMOTION_BENCH_SEQUENCES", "500"))
N_ROUNDS = int(os.environ.get("MODALMOTION_BENCH_ROUNDS", "3"))
LEAST_RATIO = 1.7
_LIMITS = (300.0, 6_000_000_000)

OpenEngine = Callable[[Path], Engine]


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
        with _dask(1) as one, _dask(2) as two:
            engines: dict[str, OpenEngine] = {
                "Dask, 1 worker": lambda folder: DaskExecutor(one, folder, *_LIMITS),
                "Dask, 2 workers": lambda folder: DaskExecutor(two, folder, *_LIMITS),
                "pebble, 1 process": lambda _: WorkerPool(1, *_LIMITS),
                "pebble, 2 processes": lambda _: WorkerPool(2, *_LIMITS),
            }
            return [_scaling(job, engines), _batches(job, engines["Dask, 2 workers"]), _costs()]


@contextmanager
def _dask(n_workers: int) -> Iterator[str]:
    import dask
    from distributed import LocalCluster

    # A worker of a nanny must be allowed children: the processes that tasks run in.
    with (
        dask.config.set({"distributed.worker.daemon": False}),
        LocalCluster(
            n_workers=n_workers,
            threads_per_worker=1,
            memory_limit=0,
            dashboard_address="127.0.0.1:0",
            host="127.0.0.1",
        ) as cluster,
    ):
        yield cluster.scheduler_address


def _seconds(job: CohortJob, open_engine: OpenEngine) -> float:
    """Time of a cohort in a new folder, from when the workers' processes are there."""
    started = []

    def open_warm(folder: Path) -> Engine:
        engine = open_engine(folder)
        for future in [engine.submit(time.sleep, 0.2) for _ in range(2 * engine.n_workers)]:
            future.result()
        started.append(time.perf_counter())
        return engine

    with tempfile.TemporaryDirectory() as name:
        report = sign_cohort(replace(job, folder=Path(name) / "out"), open_warm)
        seconds = time.perf_counter() - started[0]
    assert report.n_made == len(job.entries)
    return seconds


def _scaling(job: CohortJob, engines: dict[str, OpenEngine]) -> Table:
    table = Table(
        f"A cohort of {len(job.entries)} simulated ventricles (medians of {N_ROUNDS}, in turn)",
        ("work", "seconds", "a sequence", "against one"),
    )
    samples: dict[str, list[float]] = {name: [] for name in (*engines, "one", "two")}
    for _ in range(N_ROUNDS):
        for name, open_engine in engines.items():
            samples[name].append(_seconds(job, open_engine))
        for name, n in (("one", 1), ("two", 2)):
            samples[name].append(_plain(n))
    medians = {name: statistics.median(times) for name, times in samples.items()}
    for name in engines:
        seconds, alone = medians[name], name.split(",")[0]
        cells = (name, f"{seconds:.2f}", in_words(seconds / len(job.entries)))
        if "2" not in name:
            table.add(*cells, "")
            continue
        (first,) = (other for other in engines if other.startswith(alone) and "1" in other)
        ratio = medians[first] / seconds
        if alone == "Dask":
            table.add_at_least(ratio, LEAST_RATIO, *cells, f"{ratio:.2f}")
        else:
            table.add(*cells, f"{ratio:.2f}")
    ratio = 2 * medians["one"] / medians["two"]
    table.add("two plain processes that only count", f"{medians['two']:.2f}", "", f"{ratio:.2f}")
    return table


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


def _batches(job: CohortJob, open_engine: OpenEngine) -> Table:
    table = Table(
        f"Files in one piece of work, {len(job.entries)} sequences on Dask's 2 workers",
        ("files", "seconds", "a sequence"),
    )
    for size in (1, 2, 4, 8, 16, 32):
        times = [_seconds(replace(job, batch=size), open_engine) for _ in range(N_ROUNDS)]
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
