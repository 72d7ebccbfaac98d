"""A long cohort over Dask, with a worker and the scheduler killed on the way."""

from __future__ import annotations

import csv
import os
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import psutil
from measure import Table, in_words

from modalmotion.store import ResultStore

N_SEQUENCES: Final = int(os.environ.get("MODALMOTION_BENCH_ENDURANCE", "2000"))
MOST_RATIO: Final = 1.1
MOST_GROWTH: Final = 1.05
# Shares of the cohort: of the two stretches that are compared, and of the two deaths.
START, END = (0.08, 0.28), (0.76, 0.96)
WORKER_DIES, SCHEDULER_DIES = 0.3, 0.6
_HOST: Final = "127.0.0.1"


def run(_folder: Path | None = None) -> list[Table]:
    """Run the cohort once, and compare its end with its start."""
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        _write(root / "in", N_SEQUENCES)
        with ExitStack() as stack:
            cluster = _Cluster(root)
            stack.callback(cluster.stop)
            samples = _run(root, cluster)
        return [_table(samples), _outcome(root)]


def _write(folder: Path, n: int) -> None:
    folder.mkdir()
    rng = np.random.default_rng(4)
    still = rng.normal(size=(36, 3))
    for number in range(n):
        vertices = (still + 0.1 * rng.normal(size=(4, 36, 3))).astype(np.float32)
        path = folder / f"{number:07d}.npz"
        np.savez(path, vertices=vertices, grid=(6, 6), topology="cup", unit="mm")


@dataclass
class _Cluster:
    """A scheduler and two workers of one process each, as they are deployed."""

    root: Path
    address: str = ""
    scheduler: subprocess.Popen[bytes] | None = None
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        with socket.socket() as probe:
            probe.bind((_HOST, 0))
            self.address = f"tcp://{_HOST}:{probe.getsockname()[1]}"
        self.start_scheduler()
        self.start_worker()
        self.start_worker()

    def start_scheduler(self) -> None:
        port = self.address.rpartition(":")[2]
        self.scheduler = self.start(
            *("distributed.cli.dask_scheduler", "--host", _HOST, "--port", port),
            *("--no-dashboard", "--dashboard-address", f"{_HOST}:0"),
        )

    def start_worker(self) -> None:
        worker = ("modalmotion", "worker", self.address, "--host", _HOST, "--processes", "1")
        self.workers.append(self.start(*worker))

    def start(self, *arguments: str) -> subprocess.Popen[bytes]:
        environment = {
            **os.environ,
            "DASK_TEMPORARY_DIRECTORY": str(self.root),
            **{f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS")},
        }
        with (self.root / "log").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", *arguments], env=environment, stdout=log, stderr=log
            )

    def processes(self) -> list[int]:
        """Ids of what is there."""
        started = [*self.workers, *([self.scheduler] if self.scheduler else [])]
        return [process.pid for process in started if process.poll() is None]

    def stop(self) -> None:
        started = [*self.workers, *([self.scheduler] if self.scheduler else [])]
        for process in started:
            process.terminate()
        for process in started:
            process.wait()


@dataclass(frozen=True)
class _Sample:
    n_done: int
    clock: float
    cluster: float
    coordinator: float
    memory: int


def _run(root: Path, cluster: _Cluster) -> list[_Sample]:
    command = ("cohort", str(root / "in"), "-o", str(root / "out"), "--modes", "6")
    coordinator = cluster.start("modalmotion", *command, "--scheduler", cluster.address)
    seen = psutil.Process(coordinator.pid)
    samples: list[_Sample] = []
    ledger, n_done, read = root / "out" / "cohort.jsonl", 0, 0
    deaths = {"worker": WORKER_DIES, "scheduler": SCHEDULER_DIES}
    while coordinator.poll() is None:
        time.sleep(0.2)
        if ledger.is_file():
            with ledger.open("rb") as file:
                file.seek(read)
                new = file.read()
            n_done, read = n_done + new.count(b"\n"), read + len(new)
        with suppress(psutil.Error):
            samples.append(
                _Sample(
                    n_done,
                    time.perf_counter(),
                    sum(map(_seconds, cluster.processes())),
                    _seconds(coordinator.pid),
                    seen.memory_info().rss,
                )
            )
        for what in [what for what, share in deaths.items() if n_done > share * N_SEQUENCES]:
            del deaths[what]
            print(f"{n_done} done: the {what} is killed", flush=True)
            if what == "worker":
                cluster.workers.pop(0).kill()
                cluster.start_worker()
            else:
                assert cluster.scheduler is not None
                cluster.scheduler.kill()
                cluster.scheduler.wait()
                time.sleep(1)
                cluster.start_scheduler()
    assert coordinator.returncode == 0, (root / "log").read_text()[-3000:]
    assert not deaths
    return samples


def _seconds(pid: int) -> float:
    """Processor time of a process with what it has started."""
    total = 0.0
    with suppress(psutil.Error):
        first = psutil.Process(pid)
        for process in (first, *first.children(recursive=True)):
            with suppress(psutil.Error):
                times = process.cpu_times()
                total += times.user + times.system
    return total


def _table(samples: list[_Sample]) -> Table:
    table = Table(
        f"A cohort of {N_SEQUENCES:,} small sequences over Dask, 2 workers; one and the scheduler "
        "killed on the way",
        ("", "start", "end", "ratio"),
    )
    starts, ends = _stretch(samples, START), _stretch(samples, END)
    for name, part in (
        ("processor of all, a sequence", lambda s: s.cluster + s.coordinator),
        ("of the coordinator", lambda s: s.coordinator),
    ):
        start, end = _each(starts, part), _each(ends, part)
        table.add_at_most(
            end / start, MOST_RATIO, name, in_words(start), in_words(end), f"{end / start:.3f}"
        )
    start, end = _each(starts, lambda s: s.clock), _each(ends, lambda s: s.clock)
    table.add("clock, a sequence", in_words(start), in_words(end), f"{end / start:.3f}")
    before, after = starts[0].memory, ends[-1].memory
    cells = (f"{before / 1e6:.0f} MB", f"{after / 1e6:.0f} MB", f"{after / before:.3f}")
    table.add_at_most(after / before, MOST_GROWTH, "memory of the coordinator", *cells)
    seconds = samples[-1].clock - samples[0].clock
    tenths = [_stretch(samples, (k / 10, 1.0))[0].memory for k in range(1, 10)]
    print("coordinator, at each tenth:", *(f"{memory / 1e6:.1f}" for memory in tenths), "MB")
    table.add("in all", "", in_words(seconds), f"{1e3 * seconds / N_SEQUENCES:.2f} ms each")
    return table


def _stretch(samples: list[_Sample], shares: tuple[float, float]) -> list[_Sample]:
    first, last = (share * N_SEQUENCES for share in shares)
    return [sample for sample in samples if first <= sample.n_done <= last]


def _each(stretch: list[_Sample], part: object) -> float:
    assert callable(part)
    first, last = stretch[0], stretch[-1]
    return float(part(last) - part(first)) / (last.n_done - first.n_done)


def _outcome(root: Path) -> Table:
    table = Table("What came of them", ("", "number"))
    with (root / "out" / "cohort.csv").open() as file:
        rows = list(csv.DictReader(file))
    names = [row["sequence_id"] for row in rows if not row["error"]]
    lines = (root / "out" / "cohort.jsonl").read_text().splitlines()
    with ResultStore(root / "out") as store:
        n_stored = store.count()["signature"]
    n_files = sum(1 for _ in (root / "out" / "signatures").rglob("*.h5"))
    lost = N_SEQUENCES - min(len(set(names)), n_stored, n_files)
    table.add_at_most(lost, 0, "lost", str(lost))
    twice = max(len(names), len(lines), n_stored, n_files) - N_SEQUENCES
    table.add_at_most(twice, 0, "twice", str(twice))
    return table
