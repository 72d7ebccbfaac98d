"""The service as a process of its own: its answers beside a bare upload, its start, its memory."""

from __future__ import annotations

import http.client
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlencode

import numpy as np
from measure import USUAL_SECONDS, fixed_work

from modalmotion.mesh.sequence import MeshSequence
from modalmotion.simulate import Acquisition, simulate_ventricle

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from running import RunningService  # noqa: E402 (found on the path just set)

# 25 frames x 3,300 vertices x 3 float32: 990,000 bytes.
GRID: Final = (66, 50)
N_CONNECTIONS: Final = 4
BARE: Final = "receive and hash"
SETTINGS: Final = {"MAX_REQUESTS_PER_MINUTE": "1000000", "WAIT_SECONDS": "600"}
"""However busy the machine is, requests are answered."""


@dataclass
class Answers:
    """What a kind of request took, round by round.

    Parameters
    ----------
    shares : list of float
        Of the rate of a bare upload of the same bytes in the same round.
    processor : list of float, s
        Of all processes of the service, a request, over that of a fixed piece of NumPy work.
    """

    shares: list[float] = field(default_factory=list)
    processor: list[float] = field(default_factory=list)

    @property
    def share(self) -> float:
        """Percent of the rate of a bare upload, median of rounds."""
        return 100.0 * statistics.median(self.shares)

    @property
    def milliseconds(self) -> float:
        """Processor time of a core that does the fixed work in the usual time."""
        return 1e3 * USUAL_SECONDS * statistics.median(self.processor)


def large_beat() -> MeshSequence:
    """Simulate a beat whose float32 take a megabyte."""
    beat = Acquisition(n_frames=25, noise=0.6)
    return simulate_ventricle(grid=GRID, acquisition=beat, rng=np.random.default_rng(1994))


def answers(n_rounds: int, seconds: float) -> dict[str, Answers]:
    """Load the service in turn with bare uploads, signatures, classes and stored signatures."""
    body = large_beat().vertices.astype("<f4").tobytes()
    known = {"format": "raw", "grid": f"{GRID[0]},{GRID[1]}", "topology": "cup", "unit": "mm"}
    with running([str(ROOT / "benchmarks" / "load_server.py")]) as service:
        template = service.request("POST", f"/v1/templates?{urlencode(known)}", body).json["id"]
        stored = service.request("POST", f"/v1/sequences?{urlencode(known)}", body).json["id"]
        whole = urlencode({**known, "template": template})
        requests = {
            BARE: ("POST", "/v1/decode", body, {}),
            "signature": ("POST", f"/v1/signature?{whole}", body, {"Accept": "application/json"}),
            "class": ("POST", f"/v1/classify?{urlencode(known)}", body, {}),
            "stored": ("GET", f"/v1/sequences/{stored}/signature", None, {}),
        }
        found = {name: Answers() for name in requests}
        for sent in requests.values():
            load(service.port, seconds, *sent)  # warm
        for _ in range(n_rounds):
            rates = {}
            for name, sent in requests.items():
                before, work = sum(service.cpu_seconds().values()), _work()
                n, took = load(service.port, seconds, *sent)
                spent = sum(service.cpu_seconds().values()) - before
                found[name].processor.append(spent / n / ((work + _work()) / 2))
                rates[name] = n / took
            for name, rate in rates.items():
                found[name].shares.append(rate / rates[BARE])
    return found


def load(port: int, seconds: float, *sent: Any) -> tuple[int, float]:
    """Send a request again and again over each of several connections; how many, in what time."""
    start = time.perf_counter()

    def send(_: int) -> int:
        n, connection = 0, http.client.HTTPConnection("127.0.0.1", port, timeout=60)
        while time.perf_counter() < start + seconds:
            connection.request(*sent)
            answer = connection.getresponse()
            found = answer.read()
            assert answer.status == 200, found[:1000]
            n += 1
        connection.close()
        return n

    with ThreadPoolExecutor(N_CONNECTIONS) as threads:
        n = sum(threads.map(send, range(N_CONNECTIONS)))
    return n, time.perf_counter() - start


def start() -> tuple[float, int, float]:
    """Start the service as installed packages are, compiled once.

    Returns
    -------
    float, int, float
        Processor seconds of all processes until it is ready, processes, and megabytes at rest.
    """
    with tempfile.TemporaryDirectory() as cache:
        os.environ |= {"PYTHONPYCACHEPREFIX": cache, "PYTHONDONTWRITEBYTECODE": ""}
        with running():
            pass
        with running() as service:
            seconds = sum(service.cpu_seconds().values())
            time.sleep(1.0)
            return seconds, len(service.processes()), service.memory() / 1e6


@contextmanager
def running(program: list[str] | None = None) -> Iterator[RunningService]:
    """Serve an empty folder on this machine only."""
    with tempfile.TemporaryDirectory() as place:
        service = RunningService(Path(place) / "results", SETTINGS, is_warm=False)
        service.program = program or []
        try:
            yield service.start()
        finally:
            service.stop()


def _work() -> float:
    start = time.process_time()
    for _ in range(10):
        fixed_work()
    return (time.process_time() - start) / 10
