"""A scheduler and its workers, as processes of their own."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

from project import ROOT
from warm_start import WarmProcess, start_warm

Started = subprocess.Popen[bytes] | WarmProcess


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@dataclass
class DaskCluster:
    """Everything listens on 127.0.0.1; `stop` ends what was started here, and nothing else."""

    folder: Path
    port: int = field(default_factory=free_port)
    scheduler: Started | None = None
    workers: list[Started] = field(default_factory=list)

    @property
    def address(self) -> str:
        return f"tcp://127.0.0.1:{self.port}"

    def start(self, n_workers: int, n_processes: int = 1) -> DaskCluster:
        self.start_scheduler()
        for _ in range(n_workers):
            self.start_worker(n_processes)
        self.wait_for_workers(n_workers)
        return self

    def wait_for_workers(self, n: int) -> None:
        from distributed import Client

        with Client(self.address, set_as_default=False, timeout=60) as client:
            client.wait_for_workers(n, timeout=60)

    def start_scheduler(self) -> None:
        self.scheduler = self._run(
            *("-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1"),
            *("--port", str(self.port), "--no-dashboard", "--dashboard-address", "127.0.0.1:0"),
        )
        for _ in range(600):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", self.port)) == 0:
                    return
            assert self.scheduler.poll() is None, self.log
            time.sleep(0.05)
        raise AssertionError(f"no scheduler: {self.log}")

    def start_worker(self, n_processes: int = 1) -> Started:
        return self.start_program(
            *("-m", "distributed.cli.dask_worker", self.address, "--host", "127.0.0.1"),
            *("--no-nanny", "--no-dashboard", "--nthreads", str(n_processes)),
        )

    def start_program(self, *arguments: str) -> Started:
        """Start what is to be one of the workers."""
        worker = self._run(*arguments)
        self.workers.append(worker)
        return worker

    def kill_scheduler(self) -> None:
        assert self.scheduler is not None
        self.scheduler.kill()
        self.scheduler.wait()

    def stop(self) -> None:
        processes = [*self.workers, *([self.scheduler] if self.scheduler else [])]
        for process in processes:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
        for process in processes:
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    @property
    def log(self) -> str:
        path = self.folder / "dask.log"
        return path.read_text()[-5000:] if path.exists() else ""

    def _run(self, *arguments: str) -> Started:
        self.folder.mkdir(parents=True, exist_ok=True)
        # Tasks of the tests are imported by name; what Dask writes goes to a folder of ours.
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(
                [str(ROOT / "tests" / "support"), os.environ.get("PYTHONPATH", "")]
            ),
            "DASK_TEMPORARY_DIRECTORY": str(self.folder),
            "OMP_NUM_THREADS": "1",
        }
        with (self.folder / "dask.log").open("ab") as sink:
            if arguments[0] == "-m":
                return start_warm(
                    "cluster",
                    *arguments[1:],
                    environment=environment,
                    folder=self.folder,
                    sink=sink,
                )
            return subprocess.Popen(
                [sys.executable, *arguments],
                env=environment,
                cwd=self.folder,
                stdout=sink,
                stderr=subprocess.STDOUT,
            )
