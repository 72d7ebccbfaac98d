"""What a cluster adds: machines that are not there, are lost, or do not share the folder."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from dask_cluster import DaskCluster, free_port
from distributed.core import Status
from fastapi.testclient import TestClient
from warm_start import start_warm
from worker_tasks import hang, is_running, slow_mark

from modalmotion_service.app import create_app
from modalmotion_service.errors import ClusterError
from modalmotion_service.settings import Settings
from modalmotion_service.work.answers import from_bytes
from modalmotion_service.work.dask import tasks as dask_tasks
from modalmotion_service.work.dask.executor import DaskExecutor
from modalmotion_service.work.dask.tasks import PLUGIN, Mark, PoolLimits, Pools, run_in_pool
from modalmotion_service.work.payload import payload_of
from modalmotion_service.work.terms import NO_TERMS

MEMORY = 3_000_000_000
# In s, between two looks at the workers.
LOOK = 0.1


@pytest.fixture
def own_cluster(tmp_path: Path, warm_bridges: None) -> Iterator[DaskCluster]:
    """One whose processes the test may kill."""
    cluster = DaskCluster(tmp_path / "dask")
    yield cluster
    cluster.stop()


def until(holds: Callable[[], bool], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, "it does not come to pass"
        time.sleep(0.02)


def is_ready(engine: DaskExecutor) -> bool:
    try:
        engine.require_ready()
    except ClusterError:
        return False
    return True


def test_the_bridge_imports_dask_and_no_more_of_the_service_than_it_needs() -> None:
    program = "import sys, modalmotion_service.work.dask.bridge; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    imported = set(run.stdout.decode().split())
    assert "distributed" in imported
    # They take longer than all else.
    assert not imported & {"fastapi", "scipy", "modalmotion.store", "modalmotion_service.settings"}


@pytest.mark.thorough
def test_a_scheduler_that_is_not_there_is_named(tmp_path: Path, warm_bridges: None) -> None:
    address = f"tcp://127.0.0.1:{free_port()}"
    with pytest.raises(ClusterError, match="no scheduler") as caught:
        DaskExecutor(address, tmp_path, 2.0, MEMORY, connect_seconds=0.5)
    assert address in caught.value.message
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ClusterError, match="no scheduler"):
        DaskExecutor("nonsense", tmp_path, 2.0, MEMORY, connect_seconds=0.5)


@pytest.mark.thorough
def test_the_service_says_so_at_its_start_and_ends(tmp_path: Path) -> None:
    environment = {
        **os.environ,
        "MODALMOTION_SCHEDULER": f"tcp://127.0.0.1:{free_port()}",
        "MODALMOTION_CLUSTER_SECONDS": "0.5",
    }
    log = tmp_path / "log"
    with log.open("wb") as sink:
        run = start_warm(
            "server",
            *("modalmotion", "serve", "--port", "0", "--data-dir", str(tmp_path / "d")),
            environment=environment,
            folder=tmp_path,
            sink=sink,
        )
    assert run.wait(60) == 1
    assert "There is no scheduler at" in log.read_text()
    assert "Traceback" not in log.read_text()


def test_a_scheduler_without_workers_is_refused(own_cluster: DaskCluster, tmp_path: Path) -> None:
    own_cluster.start_scheduler()
    with pytest.raises(ClusterError, match="no workers"):
        DaskExecutor(own_cluster.address, tmp_path, 2.0, MEMORY, connect_seconds=2.0)


def test_a_worker_elsewhere_or_of_another_version_is_refused(tmp_path: Path) -> None:
    mark = tmp_path / "cluster.1"
    with pytest.raises(ClusterError, match="does not see the data folder"):
        Mark(mark, version("modalmotion")).require_here()
    mark.touch()
    Mark(mark, version("modalmotion")).require_here()
    with pytest.raises(ClusterError, match=r"0\.0\.0"):
        Mark(mark, "0.0.0").require_here()


@pytest.mark.thorough
def test_a_worker_that_loses_the_folder_does_no_work(
    dask_cluster: DaskCluster, tmp_path: Path
) -> None:
    with DaskExecutor(dask_cluster.address, tmp_path, 20.0, MEMORY) as engine:
        (mark,) = (path for path in tmp_path.iterdir() if path == engine._mark)
        mark.unlink()
        with pytest.raises(ClusterError, match="does not see the data folder"):
            engine.submit(abs, -1).result(timeout=30)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.thorough
def test_pools_of_many_limits_are_closed_but_for_those_in_use_and_the_last() -> None:
    limits = [PoolLimits(20.0, MEMORY + n, 3) for n in range(6)]
    pools = Pools(1)
    with pools.pool(limits[0]) as first:
        pid = first.submit(os.getpid).result(timeout=30)
        for other in limits[1:]:
            with pools.pool(other) as pool:
                assert pool.submit(abs, -1).result(timeout=30) == 1
        # The one in use, and the last two.
        assert len(pools) == 3
        assert first.submit(os.getpid).result(timeout=30) == pid
    assert len(pools) == 2
    with pools.pool(limits[5]) as last, pools.pool(limits[5]) as same:
        assert last is same
        kept = last.submit(os.getpid).result(timeout=30)
    until(lambda: not is_running(pid))
    pools.close()
    assert len(pools) == 0
    until(lambda: not is_running(kept))


@pytest.mark.thorough
def test_two_clients_share_workers_and_one_may_leave(
    dask_cluster: DaskCluster, tmp_path: Path
) -> None:
    folders = [tmp_path / name for name in "ab"]
    for folder in folders:
        folder.mkdir()
    with DaskExecutor(dask_cluster.address, folders[0], 20.0, MEMORY) as stays:
        slow = stays.submit(slow_mark, tmp_path / "mark", 0.5)
        with DaskExecutor(dask_cluster.address, folders[1], 20.0, MEMORY) as leaves:
            assert leaves.submit(abs, -1).result(timeout=30) == 1
        assert slow.result(timeout=30) == "done"


def test_a_worker_that_ends_gives_up_the_work_under_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mark = Mark(tmp_path / "mark", version("modalmotion"))
    mark.path.touch()
    limits, pools = PoolLimits(60.0, MEMORY, 1), Pools(1)
    task = SimpleNamespace(state="executing")
    worker = SimpleNamespace(
        get_current_task=lambda: "key",
        plugins={PLUGIN: SimpleNamespace(pools=pools)},
        state=SimpleNamespace(tasks={"key": task}),
        # Dask waits half a minute for the threads of a worker that has lost its scheduler.
        status=Status.closing,
    )
    monkeypatch.setattr(dask_tasks, "get_worker", lambda: worker)
    with pytest.raises(ClusterError, match="given up"):
        run_in_pool(payload_of(hang, (), {}), limits, mark, NO_TERMS)
    worker.status = Status.running
    answer = run_in_pool(payload_of(abs, (-1,), {}), limits, mark, NO_TERMS)
    assert from_bytes(answer, int) == 1
    pools.close()


def test_a_lost_worker_or_scheduler_is_survived(own_cluster: DaskCluster, tmp_path: Path) -> None:
    own_cluster.start(2)
    folder = tmp_path / "shared"
    folder.mkdir()
    with DaskExecutor(
        *(own_cluster.address, folder, 60.0, MEMORY),
        patience_seconds=1.0,
        connect_seconds=5.0,
        look_seconds=LOOK,
    ) as engine:
        # A worker is killed at work: the other one does its part.
        tasks = [engine.submit(slow_mark, tmp_path / f"{n}", 0.3) for n in range(8)]
        until(lambda: (tmp_path / "1").exists())
        own_cluster.workers[0].kill()
        assert [task.result(timeout=60) for task in tasks] == ["done"] * 8
        # The scheduler is killed: what is under way fails soon, and so does what comes then.
        stuck = engine.submit(hang)
        time.sleep(0.3)
        own_cluster.kill_scheduler()
        assert isinstance(stuck.exception(timeout=20), ClusterError)
        until(lambda: not is_ready(engine))
        assert isinstance(engine.submit(abs, -1).exception(timeout=20), ClusterError)
        # It returns, and so does the worker that is left.
        own_cluster.start_scheduler()
        until(lambda: is_ready(engine))
        assert engine.submit(abs, -1).result(timeout=60) == 1
        # The last worker is killed: its work does not wait for ever.
        stuck = engine.submit(hang)
        time.sleep(0.3)
        own_cluster.workers[1].kill()
        assert isinstance(stuck.exception(timeout=60), ClusterError)
        assert not is_ready(engine)


@pytest.mark.thorough
def test_a_stopped_worker_is_not_ready_and_its_work_goes_to_others(
    own_cluster: DaskCluster, tmp_path: Path
) -> None:
    own_cluster.start(1)
    folder = tmp_path / "shared"
    folder.mkdir()
    with DaskExecutor(
        *(own_cluster.address, folder, 60.0, MEMORY),
        patience_seconds=0.5,
        silent_seconds=1.0,
        look_seconds=LOOK,
    ) as engine:
        assert is_ready(engine)
        own_cluster.workers[0].send_signal(signal.SIGSTOP)
        try:
            # At once, not when somebody has waited long enough.
            assert not is_ready(engine)
            stuck = engine.submit(abs, -1)
            assert isinstance(stuck.exception(timeout=60), ClusterError)
            own_cluster.start_worker()
            until(lambda: is_ready(engine))
            assert engine.submit(abs, -1).result(timeout=60) == 1
        finally:
            own_cluster.workers[0].send_signal(signal.SIGCONT)
        until(lambda: engine.n_workers == 2)
        tasks = [engine.submit(slow_mark, tmp_path / f"{n}", 0.3) for n in range(4)]
        until(lambda: (tmp_path / "0").exists())
        own_cluster.workers[1].send_signal(signal.SIGSTOP)
        try:
            assert [task.result(timeout=60) for task in tasks] == ["done"] * 4
        finally:
            own_cluster.workers[1].send_signal(signal.SIGCONT)


@pytest.mark.parametrize(
    "number", [signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.soak)]
)
def test_a_bridge_that_ends_or_stops_is_replaced(
    number: signal.Signals,
    dask_cluster: DaskCluster,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("modalmotion_service.work.dask.executor._SILENT_SECONDS", 10.0)
    with DaskExecutor(dask_cluster.address, tmp_path, 60.0, MEMORY, look_seconds=LOOK) as engine:
        stuck = engine.submit(hang)
        assert engine.bridge is not None
        engine.bridge.send_signal(number)
        assert isinstance(stuck.exception(timeout=60), ClusterError)
        assert isinstance(engine.submit(abs, -1).exception(timeout=60), ClusterError)
        until(lambda: is_ready(engine))
        assert engine.submit(abs, -1).result(timeout=60) == 1


HOSTILE = """
import os, sys
from modalmotion_service.work.dask import tasks
from modalmotion.cli import main

class Bomb:
    def __reduce__(self):
        code = f"open({sys.argv[-1]!r}, 'a').write(str(__import__('os').getpid()) + ' ')"
        return exec, (code,)

class BadError(Exception):
    def __reduce__(self):
        return Bomb().__reduce__()

def answer(payload, limits, mark, terms):
    if b"getpid" in payload:
        raise BadError
    return Bomb()

tasks.run_in_pool = answer
answer.__module__, answer.__qualname__ = tasks.__name__, "run_in_pool"
main(sys.argv[1:-1])
"""


@pytest.mark.thorough
def test_a_hostile_worker_runs_no_code_in_the_service(
    own_cluster: DaskCluster, tmp_path: Path
) -> None:
    own_cluster.start_scheduler()
    pids = tmp_path / "pids"
    own_cluster.start_program(
        *("-c", HOSTILE, "worker", own_cluster.address, "--host", "127.0.0.1", str(pids))
    )
    own_cluster.wait_for_workers(1)
    folder = tmp_path / "shared"
    folder.mkdir()
    with DaskExecutor(own_cluster.address, folder, 60.0, MEMORY) as engine:
        for task in (engine.submit(abs, -1), engine.submit(os.getpid)):
            assert task.exception(timeout=60) is not None
    # It did run somewhere, else this test shows nothing.
    assert pids.read_text().split()
    assert str(os.getpid()) not in pids.read_text().split()


@pytest.mark.soak
def test_the_service_waits_for_a_scheduler_that_returns(
    own_cluster: DaskCluster, tmp_path: Path, beat: bytes
) -> None:
    own_cluster.start(1)
    settings = Settings(
        data_dir=tmp_path / "results", scheduler=own_cluster.address, wait_seconds=120.0
    )
    with TestClient(create_app(settings), raise_server_exceptions=False) as client:
        assert client.get("/health/ready").status_code == 200
        assert client.post("/v1/sequences", content=beat).status_code == 201
        own_cluster.kill_scheduler()
        until(lambda: client.get("/health/ready").status_code == 503)
        answer = client.get(f"/v1/sequences/{sequence_id(client)}/signature")
        assert (answer.status_code, answer.json()["code"]) == (503, "cluster_unavailable")
        assert answer.headers["retry-after"]
        job: dict[str, Any] = client.get(
            f"/v1/sequences/{sequence_id(client)}/signature", headers={"Prefer": "respond-async"}
        ).json()
        here = job["links"]["self"]
        until(lambda: client.get(here).json()["state"] == "queued")
        own_cluster.start_scheduler()
        until(lambda: client.get(here).json()["state"] == "succeeded", 90.0)
        assert client.get("/health/ready").status_code == 200


def sequence_id(client: TestClient) -> str:
    return str(client.get("/v1/sequences").json()["sequences"][0]["id"])


@pytest.mark.thorough
def test_a_cancelled_future_of_a_closed_executor_is_no_hang(
    dask_cluster: DaskCluster, tmp_path: Path
) -> None:
    engine = DaskExecutor(dask_cluster.address, tmp_path, 60.0, MEMORY)
    stuck: list[Future[None]] = [engine.submit(hang) for _ in range(3)]
    time.sleep(0.2)
    engine.shutdown(cancel_futures=True)
    engine.shutdown()
    assert all(future.cancelled() for future in stuck)
