from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
from multiprocessing import util
from pathlib import Path

import pytest

import modalmotion
from modalmotion_service.work.forks import FORKS, PRELOADED, THREADS, Forks


def test_workers_have_every_part_of_scipy_that_the_library_uses() -> None:
    # But what a parser alone needs, in a process of its own.
    known = {name.rsplit(".", n)[0] for name in PRELOADED for n in range(name.count("."))}
    known |= {"scipy.io"}
    used = {
        name
        for file in Path(modalmotion.__file__).parent.rglob("*.py")
        for name in re.findall(r"scipy\.[a-z]\w+(?:\.\w+)*", file.read_text())
    }
    assert len(used) > 20
    for name in used:
        parts = name.split(".")
        assert any(".".join(parts[:n]) in known for n in range(2, len(parts) + 1)), name


def test_it_is_begun_once() -> None:
    FORKS._begun()
    pid = FORKS.pid
    FORKS._begun()
    assert pid == FORKS.pid


def test_nothing_is_open_when_its_process_ends() -> None:
    program = "from modalmotion_service.work.forks import FORKS; FORKS._begun()"
    words = [sys.executable, "-W", "always", "-c", program]
    ended = subprocess.run(words, capture_output=True, text=True, check=True)
    assert ended.stderr == ""


def test_workers_take_one_thread_each_unless_the_environment_says_otherwise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun: list[list[str | None]] = []

    def begin(*_: object) -> int:
        begun.append([os.environ.get(name) for name in THREADS])
        return 0

    monkeypatch.setattr(util, "spawnv_passfds", begin)
    for name in THREADS:
        monkeypatch.setenv(name, "2")
        monkeypatch.delenv(name)
    for stated in ({}, {THREADS[0]: "4"}):
        for name in THREADS:
            os.environ.pop(name, None)
        os.environ.update(stated)
        forks = Forks()
        forks._begun()
        assert forks._control is not None
        forks._control.close()
    assert begun == [["1"] * len(THREADS), ["4", *[None] * (len(THREADS) - 1)]]


def test_how_a_worker_ended_is_known() -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        pid = FORKS.fork(theirs, 3_000_000_000, False)
        os.kill(pid, signal.SIGTERM)
        assert FORKS.exit_code(pid) == -signal.SIGTERM
        assert FORKS.exit_code(pid) is None
