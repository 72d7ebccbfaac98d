"""Folders that killed servers left behind are removed by the next; those of others stay."""

from __future__ import annotations

import fcntl
import os
import tempfile
from pathlib import Path

import pytest
from running import RunningService

from modalmotion_service.work.temporary import _sweep


def test_what_a_killed_server_left_is_removed_by_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Short: names of sockets have at most 107 characters.
    with tempfile.TemporaryDirectory(prefix="mm-") as place:
        monkeypatch.setenv("TMPDIR", place)
        folder = Path(place)
        others = folder / "pymp-others"
        others.mkdir()
        (others / "listener-1").touch()
        service = RunningService(tmp_path / "results", {"WORKERS": "1"})
        left: set[str] = set()
        try:
            for _ in range(3):
                service.start()
                here = {path.name for path in folder.glob("pymp-*")} - {others.name}
                assert len(here) == 1
                assert not here & left
                left |= here
                service.kill()
            service.start()
        finally:
            service.stop()
        names = {path.name for path in folder.glob("pymp-*")}
        # The last one ended by a signal too, and the next would remove what it left.
        assert others.name in names
        assert not names & left
        assert len(names) <= 2


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
