"""A scheduler and workers as they are deployed, and the processor time that each part takes."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil


@dataclass(frozen=True)
class Cluster:
    """Processes of a scheduler and its workers.

    Parameters
    ----------
    address : str
    scheduler : int
        Process id.
    workers : tuple of int
    """

    address: str
    scheduler: int
    workers: tuple[int, ...]


@dataclass(frozen=True)
class ProcessorSeconds:
    """Processor time, of user and system.

    Parameters
    ----------
    coordinator, scheduler, workers : float
        Workers with the processes that tasks run in.
    """

    coordinator: float
    scheduler: float
    workers: float

    def since(self, before: ProcessorSeconds) -> ProcessorSeconds:
        """Give what was taken since then."""
        return ProcessorSeconds(
            self.coordinator - before.coordinator,
            self.scheduler - before.scheduler,
            self.workers - before.workers,
        )


@contextmanager
def running_cluster(n_workers: int, folder: Path) -> Iterator[Cluster]:
    """Start a scheduler and `modalmotion worker`s of one process each, on this machine."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    host = ("--host", "127.0.0.1")
    scheduler = ("distributed.cli.dask_scheduler", *host, "--port", str(port), "--no-dashboard")
    worker = ("modalmotion", "worker", address, *host, "--processes", "1")
    environment = {**os.environ, "DASK_TEMPORARY_DIRECTORY": str(folder)}
    with (folder / f"dask-{port}.log").open("wb") as log:
        started = [
            subprocess.Popen(
                [sys.executable, "-m", *arguments], env=environment, stdout=log, stderr=log
            )
            for arguments in (
                (*scheduler, "--dashboard-address", "127.0.0.1:0"),
                *[worker] * n_workers,
            )
        ]
        try:
            yield Cluster(address, started[0].pid, tuple(one.pid for one in started[1:]))
        finally:
            for process in reversed(started):
                process.terminate()
            for process in started:
                process.wait()


def processor_seconds(cluster: Cluster | None) -> ProcessorSeconds:
    """Give what all have taken so far; without a cluster the workers are children of this one."""
    here = psutil.Process()
    if cluster is None:
        return ProcessorSeconds(_seconds(here), 0.0, _with_children(here) - _seconds(here))
    return ProcessorSeconds(
        _seconds(here),
        _seconds(psutil.Process(cluster.scheduler)),
        sum(_with_children(psutil.Process(worker)) for worker in cluster.workers),
    )


def _with_children(process: psutil.Process) -> float:
    return sum(map(_seconds, [process, *process.children(recursive=True)]))


def _seconds(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)
