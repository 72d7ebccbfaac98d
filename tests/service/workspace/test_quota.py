"""What one owner stores is bounded, by reading too; deletions make room."""

from __future__ import annotations

from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from modalmotion.errors import StoreError
from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings
from modalmotion_service.workspace.spool import Quota


def test_files_are_added_up_without_those_of_others(tmp_path: Path) -> None:
    for name, n_bytes in (("sequences/a/b.h5", 70), ("index.sqlite", 30), ("owners/x/c", 1000)):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(bytes(n_bytes))
    quota = Quota(tmp_path, 101)
    quota.measure()
    assert quota.used_bytes == 100
    quota.require()
    (tmp_path / "more").write_bytes(b"x")
    quota.measure()
    with pytest.raises(StoreError, match="takes 101 bytes, and may take 101"):
        quota.require()
    boundless = Quota(tmp_path)
    boundless.measure()
    boundless.require()


def test_who_only_reads_fills_no_disk(tmp_path: Path, beat: bytes) -> None:
    settings = Settings(data_dir=tmp_path, workers=1, wait_seconds=120.0, max_owner_bytes=10**9)
    with TestClient(create_app(settings)) as client:
        quota = client.app.state.owners.local.analysis.quota  # type: ignore[attr-defined]
        here = client.post("/v1/sequences", content=beat).json()["links"]["self"]
        assert client.get(f"{here}/signature").status_code == 200
        # Full from now on.
        quota.measure()
        quota.most_bytes = quota.used_bytes
        for path, body in (
            (f"{here}/signatures", {"modes": 5}),
            ("/v1/signatures/query", {"ids": [here.rpartition("/")[2]], "modes": 6}),
            (here.replace("sequences", "signatures") + "/classifications", {}),
        ):
            answer = client.post(path, json=body)
            assert (answer.status_code, answer.json()["max_owner_bytes"]) == (507, quota.used_bytes)
            assert "DELETE" in answer.json()["remedy"]
        other = client.post("/v1/sequences?unit=cm", content=beat)
        assert other.status_code == 507
        # What is there is read, and what keeps nothing is done.
        assert client.get(f"{here}/signature").status_code == 200
        assert client.post("/v1/signature", content=beat).status_code == 200
        assert client.delete(here).status_code == 204
        quota.measure()
        assert client.post("/v1/sequences?unit=cm", content=beat).status_code == 201
