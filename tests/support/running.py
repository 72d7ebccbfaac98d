"""A service in a process of its own, as a client meets it."""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from warm_start import WarmProcess, start_warm


@dataclass
class Answer:
    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.body)


@dataclass
class RunningService:
    """Start it with `start`; the same folder can be served again after any end."""

    data_dir: Path
    settings: Mapping[str, str] = field(default_factory=dict)
    port: int = 0
    process: subprocess.Popen[bytes] | WarmProcess | None = None
    log: Path = Path()
    program: Sequence[str] = ()
    """In place of `modalmotion serve`: takes the port and the folder."""
    most_files: int = 0
    """What it may open at most, unless that is 0."""
    is_warm: bool = True
    """Whether what it imports is imported already; not where the start itself is the point."""

    def start(self) -> RunningService:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        environment = {**os.environ, **{f"MODALMOTION_{k}": v for k, v in self.settings.items()}}
        # The folder of real recordings is the tests' own setting: a service would warn of it.
        environment.pop("MODALMOTION_DATA", None)
        if self.log == Path():
            self.log = self.data_dir.parent / "service.log"
        # Its own group, so that a test can end it with all of its workers.
        with self.log.open("ab") as sink:
            if self.is_warm and not self.program:
                self.process = start_warm(
                    "server",
                    *self._program()[1:],
                    environment=environment,
                    folder=Path.cwd(),
                    sink=sink,
                    is_session=True,
                    most_files=self.most_files,
                )
            else:
                self.process = subprocess.Popen(
                    [sys.executable, "-W", "error", *self._program()],
                    env=environment,
                    stdout=sink,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                )
        for _ in range(1000):
            try:
                if self.request("GET", "/health/ready").status == 200:
                    return self
            except OSError:
                assert self.process.poll() is None, self.log.read_text()[-3000:]
            time.sleep(0.02)
        raise AssertionError(f"not ready: {self.log.read_text()[-3000:]}")

    def _program(self) -> list[str]:
        port, folder = str(self.port), str(self.data_dir)
        if self.program:
            return [*self.program, port, folder]
        return ["-m", "modalmotion", "serve", "--port", port, "--data-dir", folder]

    @property
    def base(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def processes(self) -> list[int]:
        """The server, its fork server, its workers."""
        assert self.process is not None
        children: dict[int, list[int]] = {}
        for stat in Path("/proc").glob("[0-9]*/stat"):
            with contextlib.suppress(OSError):
                parent = int(stat.read_text().rpartition(")")[2].split()[1])
                children.setdefault(parent, []).append(int(stat.parent.name))
        found = [self.process.pid]
        for pid in found:
            found += children.get(pid, [])
        return found

    def memory(self) -> int:
        """Bytes in memory of all processes; pages that several share are counted once.

        Without those of files: how many others share a library at this moment is no growth.
        """
        return sum(self.memories().values())

    def memories(self) -> dict[int, int]:
        """As `memory`, of each process by its number; the server's is the first."""
        return {pid: 1024 * _kilobytes(pid) for pid in self.processes()}

    def cpu_seconds(self) -> dict[str, float]:
        """Processor time so far, of the server and of all it has started."""
        server, *others = [_cpu_seconds(pid) for pid in self.processes()]
        return {"server": server, "workers": sum(others)}

    def request(
        self,
        method: str,
        path: str,
        body: bytes | None = None,
        headers: Mapping[str, str] | None = None,
        timeout: float = 60.0,
    ) -> Answer:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=timeout)
        try:
            connection.request(method, path, body, dict(headers or {}))
            response = connection.getresponse()
            return Answer(
                response.status,
                {name.lower(): value for name, value in response.getheaders()},
                response.read(),
            )
        except http.client.HTTPException as error:
            raise ConnectionError(str(error)) from error
        finally:
            connection.close()

    def kill(self) -> None:
        """kill -9 of the server and of its workers: power off."""
        assert self.process is not None
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def terminate(self, timeout: float = 60.0) -> bool:
        """SIGTERM; tell whether the service went through its shutdown to the end."""
        assert self.process is not None
        self.process.terminate()
        # uvicorn shuts down, then lets the signal end the process as the system expects it.
        status = self.process.wait(timeout)
        last = self.log.read_text().splitlines()[-2:]
        return status == -signal.SIGTERM and "shutdown complete" in "".join(last)

    def stop(self) -> None:
        if self.process is not None and self.process.poll() is None:
            try:
                self.terminate(30.0)
            except subprocess.TimeoutExpired:
                self.kill()


def _kilobytes(pid: int) -> int:
    with contextlib.suppress(OSError):
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
        return sum(int(line.split()[1]) for line in lines if line.startswith(("Pss_A", "Pss_S")))
    return 0


def _cpu_seconds(pid: int) -> float:
    with contextlib.suppress(OSError):
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        # And of children that it has seen end, such as parsers.
        return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")
    return 0.0
