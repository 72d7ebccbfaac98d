from __future__ import annotations

import os
import re
from multiprocessing import forkserver
from pathlib import Path

import pytest

import modalmotion
from modalmotion_service.work.fork_server import PRELOADED, THREADS, begin_fork_server


def test_workers_have_every_part_of_scipy_that_the_library_uses() -> None:
    # A confined parser could not import it any more.
    known = {name.rsplit(".", n)[0] for name in PRELOADED for n in range(name.count("."))}
    used = {
        name
        for file in Path(modalmotion.__file__).parent.rglob("*.py")
        for name in re.findall(r"scipy\.[a-z]\w+(?:\.\w+)*", file.read_text())
    }
    assert len(used) > 20
    for name in used:
        parts = name.split(".")
        assert any(".".join(parts[:n]) in known for n in range(2, len(parts))), name


def test_it_is_begun_once() -> None:
    begin_fork_server()
    pid = forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined]
    begin_fork_server()
    assert pid == forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined]


def test_workers_take_one_thread_each_unless_the_environment_says_otherwise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in THREADS:
        monkeypatch.setenv(name, "2")
        monkeypatch.delenv(name)
    begin_fork_server()
    assert [os.environ[name] for name in THREADS] == ["1"] * len(THREADS)
    for name in THREADS[1:]:
        del os.environ[name]
    os.environ[THREADS[0]] = "4"
    begin_fork_server()
    assert [os.environ.get(name) for name in THREADS] == ["4", *[None] * (len(THREADS) - 1)]
