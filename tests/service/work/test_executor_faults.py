"""What an operator is told when the machine fails under a task: its disk, or its memory."""

from __future__ import annotations

import errno
import logging
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from worker_tasks import die, die_once

from modalmotion.errors import StoreError
from modalmotion_service.errors import WorkerDiedError
from modalmotion_service.http.problems import problem_body
from modalmotion_service.work.pool import WorkerPool

FULL = Path("/dev/full")


@pytest.fixture(scope="module")
def pool() -> Iterator[WorkerPool]:
    with WorkerPool(1, 20.0, 3_000_000_000) as pool:
        yield pool


@pytest.mark.skipif(not FULL.exists(), reason="this machine has no /dev/full")
def test_a_disk_that_is_full_under_a_task_is_told_as_such(pool: WorkerPool) -> None:
    with pytest.raises(StoreError, match="No space left") as caught:
        pool.submit(FULL.write_bytes, b"1").result(timeout=20)
    answer = problem_body(caught.value)
    assert (answer["status"], answer["errno"]) == (507, "ENOSPC")
    assert "Free space" in str(answer["remedy"])


def test_what_is_missing_is_a_fault_of_ours_and_not_of_the_disk(
    pool: WorkerPool, tmp_path: Path
) -> None:
    with pytest.raises(OSError, match="No such file") as caught:
        pool.submit(os.stat, tmp_path / "missing").result(timeout=20)
    assert caught.value.errno == errno.ENOENT


def test_a_process_that_is_killed_leaves_a_line_in_the_log(
    pool: WorkerPool, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        assert pool.submit(die_once, tmp_path / "mark").result(timeout=20) == "done"
        (line,) = [vars(record) for record in caplog.records]
        assert (line["task"], line["signal"], line["attempts_left"]) == ("die_once", 9, 2)
        assert line["exit_code"] is None
        caplog.clear()
        with pytest.raises(WorkerDiedError):
            pool.submit(die).result(timeout=20)
        left = [vars(record)["attempts_left"] for record in caplog.records]
    assert left == [2, 1, 0]
