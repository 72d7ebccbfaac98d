"""A disk that is nearly full, full, gone, or mounted for reading only."""

from __future__ import annotations

import errno
import os
import tempfile
from pathlib import Path
from types import SimpleNamespace

import pytest
from fastapi.testclient import TestClient

from modalmotion.errors import StoreError
from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings
from modalmotion_service.workspace.spool import LEAST_BYTES, require_room


def disk(**changes: int) -> SimpleNamespace:
    """A file system of 4 KiB blocks with 1 GB free, but for what is changed."""
    usual = {"f_flag": 0, "f_files": 1000, "f_favail": 500, "f_frsize": 4096, "f_bavail": 250_000}
    return SimpleNamespace(**{**usual, **changes})


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"f_bavail": LEAST_BYTES // 4096 - 1}, "ENOSPC"),
        ({"f_favail": 0}, "ENOSPC"),
        ({"f_flag": os.ST_RDONLY}, "EROFS"),
    ],
)
def test_a_disk_that_takes_nothing_is_told(
    changes: dict[str, int], reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "statvfs", lambda _: disk())
    require_room(tmp_path)
    monkeypatch.setattr(os, "statvfs", lambda _: disk(**changes))
    with pytest.raises(StoreError) as caught:
        require_room(tmp_path)
    assert caught.value.details["errno"] == reason
    assert caught.value.remedy


def test_a_file_system_that_numbers_no_files_has_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "statvfs", lambda _: disk(f_files=0, f_favail=0))
    require_room(tmp_path)


def test_a_mount_that_has_vanished_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stale(_: object) -> None:
        raise OSError(errno.ESTALE, os.strerror(errno.ESTALE))

    monkeypatch.setattr(os, "statvfs", stale)
    with pytest.raises(StoreError, match=os.strerror(errno.ESTALE)):
        require_room(tmp_path)


def test_below_the_reserve_uploads_are_refused_and_all_else_goes_on(
    tmp_path: Path, beat: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings(data_dir=tmp_path, workers=1, wait_seconds=120.0, reserve_bytes=10**8)
    with TestClient(create_app(settings)) as client:
        link = client.post("/v1/sequences", content=beat).json()["links"]["self"]
        monkeypatch.setattr(os, "statvfs", lambda _: disk(f_bavail=10**8 // 4096))
        for answer in (
            client.post("/v1/sequences", content=beat),
            client.post("/v1/sequences", files={"file": ("beat.npz", beat)}),
            client.post("/v1/signature", content=beat),
        ):
            told = answer.json()
            assert (answer.status_code, told["reserve_bytes"]) == (507, 10**8), told
        assert client.get("/health/ready").status_code == 200
        assert client.get(f"{link}/signature").status_code == 200
        assert client.delete(link).status_code == 204
        assert list((tmp_path / "spool").iterdir()) == []
        # Not even room for the audit log.
        monkeypatch.setattr(os, "statvfs", lambda _: disk(f_bavail=0))
        answer = client.get("/health/ready")
        assert (answer.status_code, answer.json()["code"]) == (503, "store_error")
        assert client.get("/health/live").status_code == 200


def test_a_form_takes_no_room_where_the_machine_keeps_small_things(
    tmp_path: Path, beat: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings(data_dir=tmp_path / "results", workers=1, wait_seconds=120.0)
    # Larger than what is kept in memory.
    padded = beat + b"\0" * (2 << 20)
    with TestClient(create_app(settings)) as client:
        sent = client.post("/v1/sequences", content=padded)
        # As a container's /tmp that takes nothing more.
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "missing"))
        again = client.post("/v1/sequences", files={"file": ("beat.npz", padded)})
        # The same answer, be it that the padding is refused.
        assert sent.status_code < 500
        assert (again.status_code in (200, 201)) == (sent.status_code in (200, 201))
        assert again.json().get("code") == sent.json().get("code")
        assert list((tmp_path / "results" / "spool").iterdir()) == []
