"""Thousands of damaged files over HTTP: no 5xx, no hang, and the service goes on."""

from __future__ import annotations

from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from format_mutants import mutant
from format_samples import all_files

from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings

FILES = all_files()


def send_mutants(folder: Path, n_each: int) -> int:
    settings = Settings(
        data_dir=folder,
        max_frames=1000,
        max_vertices=100_000,
        max_faces=100_000,
        max_decompressed_bytes=20_000_000,
        task_seconds=30,
    )
    n_sent = 0
    with TestClient(create_app(settings), raise_server_exceptions=False) as client:
        for name, data in FILES.items():
            for number in range(n_each):
                answer = client.post("/v1/sequences", content=mutant(name, data, number))
                n_sent += 1
                assert answer.status_code < 500, (name, number, answer.text)
                if answer.status_code >= 400:
                    assert answer.json()["remedy"], (name, number)
        assert client.get("/health/ready").status_code == 200
        assert list((folder / "spool").iterdir()) == []
    return n_sent


def test_damaged_files_are_read_or_refused(tmp_path: Path) -> None:
    assert send_mutants(tmp_path / "results", 12) >= 100


@pytest.mark.soak
def test_twenty_thousand_damaged_files(tmp_path: Path) -> None:
    n_each = -(-20_000 // len(FILES))
    n_sent = send_mutants(tmp_path / "results", n_each)
    print(f"{n_sent} mutants of {len(FILES)} files: no 5xx")  # noqa: T201
    assert n_sent >= 20_000
