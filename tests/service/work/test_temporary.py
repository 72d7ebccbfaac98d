"""Folders that killed servers left behind are removed by the next; those of others stay."""

from __future__ import annotations

import fcntl
import os
import shutil
import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from modalmotion_service.work.pool import WorkerPool
from modalmotion_service.work.temporary import _mark, _sweep, claim_temporary_folder

PROGRAM = """
import os
from modalmotion_service.work.temporary import claim_temporary_folder
print(claim_temporary_folder(), flush=True)
{end}
"""


def folder_of_process(place: Path, end: str) -> Path:
    """Folder that a process has claimed, which has ended by now."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(end=end)],
        env={**os.environ, "TMPDIR": str(place)},
        capture_output=True,
        text=True,
        check=False,
    )
    return Path(done.stdout.strip())


def test_what_a_killed_process_left_is_removed_by_the_next(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    # Short, for the sockets in it.
    tmp_path = tmp_path_factory.mktemp("t")
    others = tmp_path / "pymp-others"
    others.mkdir()
    (others / "listener-1").touch()
    left = folder_of_process(tmp_path, "os.kill(os.getpid(), 9)")
    assert left.parent == tmp_path
    assert (left / "modalmotion").exists()
    again = folder_of_process(tmp_path, "os.kill(os.getpid(), 15)")
    assert not left.exists()
    assert again.exists()
    # After an orderly end nothing is left; what is not ours stays.
    assert not folder_of_process(tmp_path, "").exists()
    assert [path.name for path in tmp_path.iterdir()] == [others.name]


def test_a_name_too_long_for_sockets_is_refused(tmp_path: Path) -> None:
    place = tmp_path / ("x" * 71)
    place.mkdir()
    done = subprocess.run(
        [sys.executable, "-m", "modalmotion", "serve", "--data-dir", tmp_path / "results"],
        env={**os.environ, "TMPDIR": str(place)},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 1
    assert f"temporary folder has {len(str(place))} bytes" in done.stderr
    assert "Set TMPDIR to a folder with a shorter name" in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(place.iterdir())


def test_whoever_begins_workers_claims_its_folder() -> None:
    with WorkerPool(1, 60.0, 1 << 32) as pool:
        assert pool.submit(abs, -1).result() == 1
        assert claim_temporary_folder.cache_info().currsize == 1
        assert (claim_temporary_folder() / "modalmotion").exists()


def test_workers_are_begun_though_the_folder_was_removed() -> None:
    with WorkerPool(1, 60.0, 1 << 32) as pool:
        pid = pool.submit(os.getpid).result()
        shutil.rmtree(claim_temporary_folder())
        os.kill(pid, signal.SIGKILL)
        assert pool.submit(os.getpid).result(timeout=60) != pid
        assert claim_temporary_folder().is_dir()


def test_a_folder_that_is_claimed_while_others_sweep_stays(tmp_path: Path) -> None:
    folders = [tmp_path / f"pymp-{n}" for n in range(300)]
    over = threading.Event()

    def sweep() -> None:
        while not over.is_set():
            _sweep(tmp_path)

    with ThreadPoolExecutor(1) as others:
        sweeping = others.submit(sweep)
        for folder in folders:
            folder.mkdir()
            _mark(folder)
        over.set()
        sweeping.result()
    assert all((folder / "modalmotion").exists() for folder in folders)


def test_the_folder_of_a_process_that_lives_is_not_swept(tmp_path: Path) -> None:
    folder = tmp_path / "pymp-alive"
    folder.mkdir()
    descriptor = os.open(folder / "modalmotion", os.O_CREAT | os.O_RDWR)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    _sweep(tmp_path)
    assert folder.exists()
    os.close(descriptor)
    _sweep(tmp_path)
    assert not folder.exists()
