"""Parsers of workers: one for an owner's turn, and the loss of one costs no task."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from access_parts import guarded
from format_samples import sequence
from worker_tasks import is_running, parse_and_tell

from modalmotion.formats import write_vtkhdf
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion_service.errors import CostError
from modalmotion_service.work import upload
from modalmotion_service.work.engine import Terms
from modalmotion_service.work.pool import WorkerPool
from modalmotion_service.work.upload import are_confined

SMALL = write_vtkhdf(sequence())


@pytest.fixture(scope="module")
def pool() -> Iterator[WorkerPool]:
    with WorkerPool(1, 300.0, 4_000_000_000) as made:
        yield made


def parsers(pool: WorkerPool, owner: str) -> tuple[int, int]:
    """Have an owner's file parsed; the worker, and its parser."""
    worker, parser = pool.submit_for(Terms(owner), parse_and_tell, SMALL).result(timeout=120)
    return worker, parser


def require_ended(*pids: int) -> None:
    end = time.monotonic() + 20
    while any(map(is_running, pids)) and time.monotonic() < end:
        time.sleep(0.01)
    assert not any(map(is_running, pids))


def test_a_parser_serves_one_owner_and_ends_with_the_turn(pool: WorkerPool) -> None:
    worker, first = parsers(pool, "lab")
    assert parsers(pool, "lab") == (worker, first)
    same, others = parsers(pool, "ward")
    assert same == worker
    assert others != first
    assert not is_running(first)


@pytest.mark.parametrize("owner", ["lab", "ward"])
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_no_loss_of_a_parser_costs_a_task(
    pool: WorkerPool, owner: str, how: signal.Signals
) -> None:
    worker, parser = parsers(pool, "lab")
    os.kill(parser, how)
    if how == signal.SIGKILL:
        require_ended(parser)
    after = parsers(pool, owner)
    assert after[1] != parser
    # One that stands still is ended with its worker, unless its turn is over.
    assert after[0] == worker or (how, owner) == (signal.SIGSTOP, "lab")
    require_ended(parser)


def test_a_parser_that_is_killed_at_work_costs_its_worker_and_no_task(pool: WorkerPool) -> None:
    worker, parser = parsers(pool, "lab")
    task = pool.submit_for(Terms("lab"), parse_and_tell, SMALL, 2_000)
    time.sleep(0.3)
    os.kill(parser, signal.SIGKILL)
    again, other = task.result(timeout=120)
    assert again != worker
    assert other != parser
    require_ended(worker, parser)


def test_the_time_of_parsers_counts_among_the_means_of_a_task(pool: WorkerPool) -> None:
    rng = np.random.default_rng(1)
    costly = write_vtkhdf(mesh_sequence(rng.normal(size=(100, 5_000, 3))))
    parsers(pool, "lab")
    with pytest.raises(CostError):
        pool.submit_for(Terms("lab", 1.0, 1.0), parse_and_tell, costly, 300).result(timeout=120)
    assert parsers(pool, "lab")


def test_the_service_says_whether_parsers_are_confined(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    with guarded(tmp_path / "one") as service:
        answer = service.client.get("/health/ready")
        assert answer.json()["parsers_confined"] is are_confined()
    monkeypatch.setattr(upload, "landlock_version", lambda: 0)
    caplog.clear()
    with guarded(tmp_path / "two") as service:
        assert "not confined" in caplog.text
        assert service.client.get("/health/ready").json()["parsers_confined"] is False
