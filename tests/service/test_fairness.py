"""However much one owner sends, another's small request is answered as in an idle service."""

from __future__ import annotations

import contextlib
import http.client
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from access_parts import guarded
from running import RunningService

from modalmotion.formats import write_npz
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion_service.access.keys import KeyRing
from modalmotion_service.access.scopes import Scope

# As many as one owner may have under way at once.
N_COSTLY = 48
COSTLY = "/v1/signature?auto=true"
SMALL = "/v1/signature"


@cache
def beat_of(grid: tuple[int, int]) -> bytes:
    noisy = Acquisition(n_frames=10, noise=0.3)
    return write_npz(simulate_ventricle(grid=grid, acquisition=noisy, rng=np.random.default_rng(1)))


@pytest.mark.thorough
def test_a_small_request_is_answered_while_anothers_costly_ones_wait(tmp_path: Path) -> None:
    done: list[str] = []
    with guarded(tmp_path) as service:
        for owner in ("a", "b"):
            assert service.ask(owner, "POST", SMALL, content=beat_of((8, 16))).status_code == 200

        def send(owner: str, path: str, grid: tuple[int, int]) -> None:
            answer = service.ask(owner, "POST", path, content=beat_of(grid))
            assert answer.status_code == 200, answer.text
            done.append(owner)

        costly = [threading.Thread(target=send, args=("a", COSTLY, (16, 32))) for _ in range(6)]
        for thread in costly:
            thread.start()
        while sum(service.client.app.state.owners.local.analysis.engine.n_waiting.values()) < 5:  # type: ignore[attr-defined]
            time.sleep(0.01)
        n_before = len(done)
        send("b", SMALL, (8, 16))
        assert len(done) <= n_before + 2
        # Long work takes turns: it waits for one of the other's at most, and not for all.
        n_before = len(done)
        send("b", COSTLY, (8, 16))
        assert len(done) <= n_before + 3
        for thread in costly:
            thread.join()
    assert done.count("a") == 6


@contextmanager
def costly_requests(service: RunningService, key: str, n: int) -> Iterator[None]:
    """Have `n` costly requests under way, each followed by another; their clients leave in the
    end."""
    body, ended, connections = beat_of((32, 64)), threading.Event(), []
    lock = threading.Lock()

    def send() -> None:
        while not ended.is_set():
            connection = http.client.HTTPConnection("127.0.0.1", service.port, timeout=600)
            with lock:
                connections.append(connection)
            with contextlib.suppress(OSError, http.client.HTTPException, ValueError):
                connection.request("POST", COSTLY, body, {"X-API-Key": key})
                connection.getresponse().read()
            connection.close()

    threads = [threading.Thread(target=send, daemon=True) for _ in range(n)]
    for thread in threads:
        thread.start()
    time.sleep(3.0)
    try:
        yield
    finally:
        ended.set()
        with lock:
            for connection in connections:
                if connection.sock is not None:
                    with contextlib.suppress(OSError):
                        connection.sock.shutdown(2)
        for thread in threads:
            thread.join()


def seconds_of(service: RunningService, key: str, n: int) -> list[float]:
    """Times of small signatures, with a little pause between them as a person makes."""
    seconds = []
    for _ in range(n):
        time.sleep(0.02)
        start = time.perf_counter()
        answer = service.request("POST", SMALL, beat_of((8, 16)), {"X-API-Key": key})
        seconds.append(time.perf_counter() - start)
        assert answer.status == 200, answer.body
    return seconds


@pytest.mark.soak
@pytest.mark.alone
@pytest.mark.parametrize("n_workers", [1, 2])
def test_a_small_signature_takes_at_most_twice_its_idle_time_beside_48_costly_ones(
    tmp_path: Path, n_workers: int, capsys: pytest.CaptureFixture[str]
) -> None:
    n_rounds = 4 * int(os.environ.get("SOAK", "1"))
    settings = {
        "WORKERS": str(n_workers),
        "REQUIRE_KEYS": "true",
        # Costly requests are answered, and not left to jobs whose files stay.
        "WAIT_SECONDS": "600",
    }
    service = RunningService(tmp_path / "results", settings).start()
    try:
        with KeyRing(service.data_dir) as ring:
            costly, small = (ring.create(owner, set(Scope))[1] for owner in ("a", "b"))
        seconds_of(service, small, 50)
        idle: list[float] = []
        busy: list[float] = []
        for _ in range(n_rounds):
            idle += seconds_of(service, small, 50)
            with costly_requests(service, costly, N_COSTLY):
                busy += seconds_of(service, small, 50)
            # What its clients have left is ended: the service is idle again at once.
            time.sleep(1.0)
    finally:
        service.stop()
    quiet, loud = (np.percentile(seconds, [50, 95]) * 1e3 for seconds in (idle, busy))
    with capsys.disabled():
        print(  # noqa: T201
            f"\n{n_workers} workers, ms: idle {quiet[0]:.1f} (median) {quiet[1]:.1f} (95 %), "
            f"beside {N_COSTLY} costly ones {loud[0]:.1f} and {loud[1]:.1f}"
        )
    assert loud[1] <= 2 * quiet[1]
