"""What was acknowledged survives: kill -9, killed workers, a full disk, SIGTERM, slow clients."""

from __future__ import annotations

import contextlib
import io
import itertools
import os
import random
import signal
import socket
import threading
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from busy_machine import busy_processes
from job_requests import ASYNC
from running import RunningService
from small_disk import SmallDisk, small_disk
from warm_start import start_warm

from modalmotion.formats import read_npz
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.store import ResultStore, verify
from modalmotion_service.work.forks import is_stopped


@pytest.fixture
def service(tmp_path: Path) -> Iterator[RunningService]:
    running = RunningService(tmp_path / "results", {"WORKERS": "2", "DRAIN_SECONDS": "5"})
    yield running
    running.stop()


def small(seed: int) -> bytes:
    vertices = np.random.default_rng(seed).normal(size=(4, 64, 3))
    buffer = io.BytesIO()
    np.savez(buffer, vertices=vertices, grid=(8, 8), topology="cup", unit="mm")
    return buffer.getvalue()


def upload_until_killed(service: RunningService, seed: int, acknowledged: dict[str, int]) -> None:
    """Upload one sequence after another; note what was acknowledged, and as what."""
    number = seed * 1_000_000
    while True:
        number += 1
        wants_job = number % 3 == 0
        headers = {"Prefer": "respond-async"} if wants_job else {}
        try:
            answer = service.request("POST", "/v1/sequences", small(number), headers)
        except OSError:
            return
        if answer.status == 429:
            continue
        assert answer.status == (202 if wants_job else 201), answer.body
        acknowledged[answer.json["links"]["self"]] = number


def finished_job(service: RunningService, link: str) -> dict[str, object]:
    for _ in range(600):
        job: dict[str, object] = service.request("GET", link).json
        if job["state"] not in ("queued", "running"):
            return job
        time.sleep(0.05)
    raise AssertionError(f"not finished after 30 s: {job}")


def crash_rounds(service: RunningService, n_rounds: int, rng: random.Random) -> int:
    acknowledged: dict[str, int] = {}
    for round_number in range(n_rounds):
        service.start()
        with ThreadPoolExecutor(4) as clients:
            uploads = [
                clients.submit(
                    upload_until_killed, service, round_number * 10 + client + 1, acknowledged
                )
                for client in range(4)
            ]
            # Every other round lets some be acknowledged first, however slow the machine is.
            patience = time.monotonic() + (20.0 if round_number % 2 == 0 else 0.0)
            enough = len(acknowledged) + 8
            while len(acknowledged) < enough and time.monotonic() < patience:
                time.sleep(0.01)
            time.sleep(rng.uniform(0.0, 0.5))
            service.kill()
        for upload in uploads:
            upload.result()
    service.start()
    for link, number in acknowledged.items():
        sequence_id = read_npz(small(number)).sequence.id
        if link.startswith("/v1/jobs/"):
            job = finished_job(service, link)
            assert job["state"] == "succeeded", job
            link = str(job["result"])
        assert link == f"/v1/sequences/{sequence_id}"
        assert service.request("GET", link).status == 200
    sampled = rng.sample(sorted(acknowledged), min(20, len(acknowledged)))
    for link in sampled:
        sequence = read_npz(small(acknowledged[link])).sequence
        here = f"/v1/sequences/{sequence.id}/signature"
        amplitudes = np.array(service.request("GET", here).json["amplitudes"])
        own = modal_signature(sequence, SignatureParameters()).amplitudes
        assert np.array_equal(amplitudes, own)
    assert service.terminate()
    report = verify(service.data_dir)
    assert not report.faults, report.faults
    with ResultStore(service.data_dir) as store:
        for link, number in acknowledged.items():
            original = read_npz(small(number)).sequence
            assert np.array_equal(store.sequence(original.id).vertices, original.vertices), link
    assert not list(service.data_dir.rglob("*.tmp"))
    return len(acknowledged)


@pytest.mark.thorough
def test_kill_9_loses_nothing_that_was_acknowledged(service: RunningService) -> None:
    assert crash_rounds(service, 2, random.Random(1)) >= 8  # noqa: S311 (no secret)


@pytest.mark.soak
def test_kill_9_two_hundred_times(service: RunningService) -> None:
    n_acknowledged = crash_rounds(service, 200, random.Random(2))  # noqa: S311 (no secret)
    print(f"200 rounds of kill -9: {n_acknowledged} acknowledged uploads, 0 lost")  # noqa: T201
    assert n_acknowledged > 2000


def workers_of(server: int) -> list[int]:
    """Processes at work for a server: children of its children."""
    parent_of: dict[int, int] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        parent_of[int(stat.parent.name)] = int(fields[1])
    return [pid for pid, parent in parent_of.items() if parent_of.get(parent) == server]


def test_killed_workers_cost_no_answer(service: RunningService) -> None:
    service.start()
    assert service.process is not None
    server, killed = service.process.pid, 0
    for number in range(5):
        for pid in workers_of(server):
            os.kill(pid, signal.SIGKILL)
            killed += 1
        assert service.request("POST", "/v1/sequences", small(number)).status == 201
    assert killed >= 4


def test_stopped_workers_are_noticed_and_replaced(service: RunningService) -> None:
    service.start()
    assert service.process is not None
    assert service.request("POST", "/v1/sequences", small(1)).status == 201
    stopped = workers_of(service.process.pid)
    for pid in stopped:
        os.kill(pid, signal.SIGSTOP)
    # The signal counts when the system has run each once more.
    while not all(map(is_stopped, stopped)):
        time.sleep(0.002)
    answer = service.request("GET", "/health/ready")
    assert (answer.status, answer.json["code"]) == (503, "no_worker")
    assert "replaced" in answer.json["remedy"]
    assert service.request("POST", "/v1/sequences", small(2)).status == 201
    assert service.request("GET", "/health/ready").status == 200


def test_sigterm_answers_what_is_under_way_and_keeps_the_rest(service: RunningService) -> None:
    service.start()
    job = service.request("POST", "/v1/sequences", small(1), {"Prefer": "respond-async"}).json
    answers: list[int] = []

    def upload(number: int) -> None:
        # Too late to be let in is no loss.
        with contextlib.suppress(ConnectionError):
            answers.append(service.request("POST", "/v1/sequences", small(number)).status)

    uploads = [threading.Thread(target=upload, args=(number,)) for number in range(2, 8)]
    for thread in uploads:
        thread.start()
    # One is answered: the others are under way, or come too late.
    while not answers and any(thread.is_alive() for thread in uploads):
        time.sleep(0.002)
    assert service.terminate()
    for thread in uploads:
        thread.join()
    assert answers
    assert set(answers) == {201}
    service.start()
    assert finished_job(service, job["links"]["self"])["state"] == "succeeded"


def test_a_second_service_on_the_folder_is_refused(service: RunningService) -> None:
    service.start()
    log = service.data_dir.parent / "second.log"
    with log.open("wb") as sink:
        second = start_warm(
            "server",
            *("modalmotion", "serve", "--port", "0", "--data-dir", str(service.data_dir)),
            environment=os.environ,
            folder=Path.cwd(),
            sink=sink,
        )
    assert second.wait(60) != 0
    assert f"{service.process.pid if service.process else 0}" in log.read_text()
    assert "Traceback" not in log.read_text()
    assert service.request("POST", "/v1/sequences", small(1)).status == 201


def open_stalled(port: int, kind: int) -> socket.socket:
    """A connection that says nothing, half a header, or half a body."""
    connection = socket.create_connection(("127.0.0.1", port), timeout=30)
    if kind % 3 == 1:
        connection.sendall(b"POST /v1/sequences HTTP/1.1\r\nHost: localhost\r\nX-Slow: ")
    elif kind % 3 == 2:
        connection.sendall(
            b"POST /v1/sequences HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000\r\n\r\nabc"
        )
    return connection


def stalled_clients(service: RunningService, n_clients: int, seconds: float) -> None:
    """Others are served meanwhile, and each stalled connection is closed in the end."""
    stalled = [open_stalled(service.port, number) for number in range(n_clients)]
    end = time.monotonic() + seconds
    number = 0
    while time.monotonic() < end:
        number += 1
        assert service.request("POST", "/v1/sequences", small(number)).status in (200, 201)
        time.sleep(0.2)
    for kind, connection in enumerate(stalled):
        with connection:
            said = b"".join(iter(lambda c=connection: c.recv(65536), b""))  # type: ignore[misc]
        if kind % 3 == 2:
            assert b" 408 " in said.splitlines()[0]
            assert b"idle_seconds" in said
        else:
            assert said == b""


def test_stalled_connections_are_closed_and_others_served(service: RunningService) -> None:
    service.settings = {**service.settings, "HEADER_SECONDS": "1", "IDLE_SECONDS": "1"}
    service.start()
    stalled_clients(service, 15, seconds=1.0)


@pytest.mark.soak
def test_fifty_stalled_connections_for_a_minute(service: RunningService) -> None:
    service.start()
    stalled_clients(service, 50, seconds=60.0)


def test_a_full_disk_is_said_and_leaves_nothing_half_written(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", "3m") as disk:
        service = RunningService(disk.folder / "results", {"RESERVE_BYTES": "0"})
        service.log = tmp_path / "service.log"
        try:
            service.start()
            kept = []
            for number in range(400):
                vertices = np.random.default_rng(number).normal(size=(20, 256, 3))
                buffer = io.BytesIO()
                np.savez(buffer, vertices=vertices, grid=(16, 16), topology="cup")
                answer = service.request("POST", "/v1/sequences", buffer.getvalue())
                if answer.status != 201:
                    break
                kept.append(answer.json["id"])
            assert (answer.status, answer.json["code"]) == (507, "store_error")
            assert answer.json["remedy"]
            assert len(kept) > 2
            for sequence_id in kept:
                assert service.request("GET", f"/v1/sequences/{sequence_id}").status == 200
            # Room is made, and the service goes on.
            for sequence_id in kept[:3]:
                assert service.request("DELETE", f"/v1/sequences/{sequence_id}").status == 204
            assert service.request("POST", "/v1/sequences", small(1)).status == 201
            service.stop()
            assert not verify(service.data_dir).faults
        finally:
            service.stop()


def fillings(service: RunningService, disk: SmallDisk, n_times: int, n_jobs: int) -> Counter[str]:
    """Fill and free the disk under load; count how the acknowledged jobs ended."""
    acknowledged: dict[str, int] = {}
    is_over = threading.Event()

    def upload(client: int) -> None:
        for number in itertools.count(1_000_000 * client):
            if is_over.is_set():
                return
            answer = service.request("POST", "/v1/sequences", small(number), ASYNC)
            # With the disk full nothing is promised.
            assert answer.status in (202, 429, 503, 507), answer.body
            if answer.status == 202:
                acknowledged[answer.json["links"]["self"]] = number
            time.sleep(0.02)

    with ThreadPoolExecutor(2) as clients:
        uploads = [clients.submit(upload, client + 1) for client in range(2)]
        try:
            for _ in range(n_times):
                enough = len(acknowledged) + n_jobs
                while len(acknowledged) < enough:
                    assert not any(done.done() for done in uploads), uploads
                    time.sleep(0.01)
                disk.fill()
                time.sleep(1.0)
                disk.free()
        finally:
            is_over.set()
    for done in uploads:
        done.result()
    ends: Counter[str] = Counter()
    for link, number in acknowledged.items():
        job = finished_job(service, link)
        ends[str(job["state"])] += 1
        assert job["state"] == "succeeded", job
        sequence_id = read_npz(small(number)).sequence.id
        assert job["result"] == f"/v1/sequences/{sequence_id}"
    return ends


def filled_disk(tmp_path: Path, n_times: int, n_jobs: int) -> Counter[str]:
    with small_disk(tmp_path / "disk", "64m") as disk:
        settings = {"RESERVE_BYTES": "0", "WORKERS": "2", "DRAIN_SECONDS": "5"}
        service = RunningService(disk.folder / "results", settings)
        service.log = tmp_path / "service.log"
        try:
            service.start()
            ends = fillings(service, disk, n_times, n_jobs)
            assert service.request("GET", "/health/ready").status == 200
            assert service.terminate()
            assert not list((service.data_dir / "spool").iterdir())
            assert not verify(service.data_dir).faults
        finally:
            service.stop()
    return ends


def test_a_disk_that_was_full_for_a_while_costs_no_acknowledged_job(tmp_path: Path) -> None:
    assert filled_disk(tmp_path, 1, 10)["succeeded"] >= 10


@pytest.mark.soak
def test_a_disk_is_filled_and_freed_fifteen_times(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    n_times = 15 * int(os.environ.get("SOAK", "1"))
    ends = filled_disk(tmp_path, n_times, 30)
    with capsys.disabled():
        print(f"\ndisk filled and freed {n_times} times: {dict(ends)}")  # noqa: T201


def test_a_store_that_is_away_for_a_while_costs_no_acknowledged_job(
    service: RunningService, tmp_path: Path
) -> None:
    service.start()
    jobs = [service.request("POST", "/v1/sequences", small(n), ASYNC).json for n in range(12)]
    # As where a volume is lost: the folder is there, and empty.
    service.data_dir.rename(tmp_path / "away")
    service.data_dir.mkdir()
    assert service.request("GET", "/health/ready").status in (200, 503)
    time.sleep(1.0)
    service.data_dir.rmdir()
    (tmp_path / "away").rename(service.data_dir)
    for number, job in enumerate(jobs):
        job = finished_job(service, job["links"]["self"])
        sequence_id = read_npz(small(number)).sequence.id
        assert (job["state"], job["result"]) == ("succeeded", f"/v1/sequences/{sequence_id}"), job


def jobs_under_kills(service: RunningService, n_kills: int, rng: random.Random) -> Counter[str]:
    """Kill workers or their fork server at random moments; count how the jobs ended."""
    assert service.process is not None
    ends: Counter[str] = Counter()
    jobs: list[str] = []
    for number in range(n_kills):
        workers = workers_of(service.process.pid)
        servers = [pid for pid in service.processes()[1:] if pid not in workers]
        what = rng.choices([workers, rng.sample(workers, min(1, len(workers))), servers], [4, 4, 1])
        for pid in what[0]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(rng.uniform(0.0, 0.02))
        answer = service.request("POST", "/v1/sequences", small(number), ASYNC, timeout=120.0)
        ends[f"answered {answer.status}"] += 1
        if answer.status == 202:
            jobs.append(answer.json["links"]["self"])
    for link in jobs:
        job = finished_job(service, link)
        failed = job["error"]["code"] if isinstance(job["error"], dict) else ""
        ends[f"{job['state']} {failed}".strip()] += 1
    return ends


def test_killed_workers_cost_no_acknowledged_job(service: RunningService) -> None:
    service.start()
    ends = jobs_under_kills(service, 8, random.Random(3))  # noqa: S311 (no secret)
    # What is killed three times at the same work may break a reader, and is failed by name.
    assert ends["succeeded"] + ends["failed worker_died"] == ends["answered 202"] == 8, ends


@pytest.mark.soak
@pytest.mark.alone
def test_three_thousand_kills_of_workers_on_a_busy_machine_cost_no_acknowledged_job(
    service: RunningService, capsys: pytest.CaptureFixture[str]
) -> None:
    service.settings = {**service.settings, "MAX_UNFINISHED_JOBS": "1000000"}
    service.start()
    n_kills = 3000 * int(os.environ.get("SOAK", "1"))
    with busy_processes(12):
        ends = jobs_under_kills(service, n_kills, random.Random(4))  # noqa: S311 (no secret)
    with capsys.disabled():
        print(f"\n{n_kills} kills of workers: {dict(ends)}")  # noqa: T201
    assert ends["succeeded"] + ends["failed worker_died"] == ends["answered 202"] == n_kills, ends
