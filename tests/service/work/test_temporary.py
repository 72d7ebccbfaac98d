"""Folders that killed servers left behind are removed by the next; those of others stay."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from modalmotion_service.commands.server import temporary_folder

PROGRAM = """
import os
from modalmotion_service.commands.server import temporary_folder
print(temporary_folder(), flush=True)
os.kill(os.getpid(), 9)
"""


def test_what_a_killed_process_left_is_removed_by_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    others = tmp_path / "others"
    others.mkdir()
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True
    )
    left = Path(done.stdout.strip())
    assert left.parent == tmp_path
    assert left.is_dir()
    (left / "upload").write_text("of somebody")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    here = temporary_folder()
    assert not left.exists()
    # That of a process that lives is not removed.
    assert temporary_folder() != here
    assert here.is_dir()
    assert others.is_dir()


def test_a_folder_that_is_made_while_others_sweep_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    over = threading.Event()

    def sweep() -> None:
        while not over.is_set():
            temporary_folder()

    with ThreadPoolExecutor(1) as others:
        sweeping = others.submit(sweep)
        folders = [temporary_folder() for _ in range(50)]
        over.set()
        sweeping.result()
    assert all(folder.is_dir() for folder in folders)
