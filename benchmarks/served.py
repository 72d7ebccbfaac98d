"""The service as a process of its own: its answers beside a bare upload, its start, its memory."""

from __future__ import annotations

import http.client
import os
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlencode

import numpy as np
from measure import of_usual_core
from numpy.typing import NDArray
from real_data import ROOT
from running import RunningService

import modalmotion as mm

# 25 frames x 3,300 vertices x 3 float32: 990,000 bytes.
GRID: Final = (66, 50)
N_CONNECTIONS: Final = 4
# However busy the machine is, requests are answered.
SETTINGS: Final = {"MAX_REQUESTS_PER_MINUTE": "1000000", "WAIT_SECONDS": "600"}


def large_beat() -> mm.MeshSequence:
    """Simulate a beat whose float32 take a megabyte."""
    beat = mm.Acquisition(n_frames=25, noise=0.6)
    return mm.simulate_ventricle(grid=GRID, acquisition=beat, rng=np.random.default_rng(1994))


def answers(n_rounds: int, seconds: float) -> NDArray[np.float64]:
    """Load the service in turn with bare uploads, signatures, classes and stored signatures.

    (3, 2) medians: of each of the last three the rate, percent of that of bare uploads in the same
    round, and processor time of all processes of the service a request, ms of a usual core.
    """
    body = large_beat().vertices.astype("<f4").tobytes()
    known = {"format": "raw", "grid": f"{GRID[0]},{GRID[1]}", "topology": "cup", "unit": "mm"}
    with running(str(ROOT / "benchmarks" / "load_server.py")) as service:
        template = service.request("POST", f"/v1/templates?{urlencode(known)}", body).json["id"]
        stored = service.request("POST", f"/v1/sequences?{urlencode(known)}", body).json["id"]
        kept = service.request("POST", f"/v1/sequences/{stored}/signatures", b"").json["key"]
        whole = urlencode({**known, "template": template})
        requests: tuple[tuple[Any, ...], ...] = (
            ("POST", "/v1/decode", body, {}),
            ("POST", f"/v1/signature?{whole}", body, {"Accept": "application/json"}),
            ("POST", f"/v1/classify?{urlencode(known)}", body, {}),
            ("GET", f"/v1/signatures/{kept}", None, {}),
        )
        rounds = []
        for _ in range(1 + n_rounds):
            taken = []
            for sent in requests:
                before, usual = sum(service.cpu_seconds().values()), of_usual_core(1e3)
                n, took = load(service.port, seconds, *sent)
                spent = sum(service.cpu_seconds().values()) - before
                taken.append((n / took, spent / n * (usual + of_usual_core(1e3)) / 2))
            rounds.append(taken)
    # Without the first round, which warms it; (requests, rounds).
    rates, milliseconds = np.array(rounds[1:]).T
    both = 100.0 * rates / rates[0], milliseconds
    return np.asarray(np.median(both, axis=2).T[1:])


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


def start(environment: dict[str, str]) -> tuple[float, int, float]:
    """Processor seconds of all processes until it is ready; processes and megabytes at rest."""
    os.environ |= environment
    with running() as service:
        seconds = sum(service.cpu_seconds().values())
        time.sleep(1.0)
        return seconds, len(service.processes()), service.memory() / 1e6


@contextmanager
def running(*program: str) -> Iterator[RunningService]:
    """Serve an empty folder on this machine only."""
    with tempfile.TemporaryDirectory() as place:
        service = RunningService(Path(place) / "results", SETTINGS, program=program, is_warm=False)
        try:
            yield service.start()
        finally:
            service.stop()
