"""Work on the workers of a scheduler: the same answers, errors and limits; what is lost is told."""

from __future__ import annotations

import os
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from dask_cluster import DaskCluster, free_port
from worker_tasks import die, hang, refuse, slow_mark, swallow_memory

from modalmotion.errors import LimitError, NonFiniteError, ParameterError
from modalmotion_service.errors import ClusterError, WorkerDiedError
from modalmotion_service.settings import Settings
from modalmotion_service.work.dask_engine import DaskEngine
from modalmotion_service.work.engine import Engine
from modalmotion_service.work.pool import open_engine


def settings_for(address: str, folder: Path, **stated: object) -> Settings:
    return Settings(
        engine="dask",
        scheduler=address,
        data_dir=folder,
        task_memory_bytes=3_000_000_000,
        **stated,  # type: ignore[arg-type]
    )


@pytest.fixture
def own_cluster(tmp_path: Path) -> Iterator[DaskCluster]:
    """One whose processes the test may kill."""
    cluster = DaskCluster(tmp_path / "dask")
    yield cluster
    cluster.stop()


def until(holds: Callable[[], bool], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, "it does not come to pass"
        time.sleep(0.05)


def test_an_engine_of_no_such_name_is_refused() -> None:
    with pytest.raises(ParameterError, match="there is no such engine") as caught:
        open_engine(Settings(engine="slurm"))
    assert "processes, dask" in caught.value.remedy


def test_a_scheduler_that_is_not_there_is_named(tmp_path: Path) -> None:
    address = f"tcp://127.0.0.1:{free_port()}"
    with pytest.raises(ClusterError, match="cannot be reached") as caught:
        DaskEngine(settings_for(address, tmp_path, cluster_seconds=0.5))
    assert address in caught.value.message


@pytest.mark.thorough
def test_answers_errors_and_limits_are_those_of_one_machine(
    dask_cluster: DaskCluster, tmp_path: Path
) -> None:
    engine = open_engine(settings_for(dask_cluster.address, tmp_path, task_seconds=5.0))
    with engine:
        engine.require_ready()
        assert engine.n_workers == 2
        assert list(engine.map(abs, [-1, 2, -3])) == [1, 2, 3]
        with pytest.raises(NonFiniteError) as refused:
            engine.submit(refuse).result(60)
        assert refused.value.frame is not None
        with pytest.raises(LimitError) as swallowed:
            engine.submit(swallow_memory).result(60)
        assert swallowed.value.limit == "task_memory_bytes"
        with pytest.raises(WorkerDiedError):
            engine.submit(die).result(60)
        with pytest.raises(LimitError) as slow:
            engine.submit(hang).result(60)
        assert slow.value.limit == "task_seconds"


@pytest.mark.thorough
def test_a_worker_elsewhere_does_no_work(dask_cluster: DaskCluster, tmp_path: Path) -> None:
    with DaskEngine(settings_for(dask_cluster.address, tmp_path)) as engine:
        shutil.rmtree(tmp_path / "cluster")
        with pytest.raises(ClusterError, match="does not see the data folder"):
            engine.submit(abs, -1).result(60)


@pytest.mark.thorough
def test_a_lost_worker_and_a_lost_scheduler_are_survived(
    own_cluster: DaskCluster, tmp_path: Path
) -> None:
    own_cluster.start(2)

    def is_ready(engine: Engine) -> bool:
        try:
            engine.require_ready()
        except ClusterError:
            return False
        return True

    with DaskEngine(settings_for(own_cluster.address, tmp_path)) as engine:
        futures = [engine.submit(slow_mark, tmp_path / f"m{k}", 1.0) for k in range(6)]
        until(lambda: bool(list(tmp_path.glob("m*"))))
        os.kill(own_cluster.workers[0].pid, signal.SIGKILL)
        for future in futures:
            future.result(120)
        own_cluster.kill_scheduler()
        lost = engine.submit(abs, -1)
        with pytest.raises(ClusterError):
            lost.result(60)
        until(lambda: not is_ready(engine))
        own_cluster.start_scheduler()
        own_cluster.start_worker()
        until(lambda: is_ready(engine))
        assert engine.submit(abs, -7).result(60) == 7
