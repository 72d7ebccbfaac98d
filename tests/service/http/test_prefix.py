"""Behind a proxy that has the service under a path of its own."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from pydantic import ValidationError

from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings


def test_paths_are_taken_with_the_prefix_and_without(tmp_path: Path, beat: bytes) -> None:
    settings = Settings(data_dir=tmp_path, workers=1, wait_seconds=120.0, path_prefix="/motion")
    with TestClient(create_app(settings)) as client:
        made = client.post("/motion/v1/sequences", content=beat)
        assert made.status_code == 201
        here = made.json()["links"]["self"]
        assert made.headers["location"] == f"/motion{here}"
        for path in (f"/motion{here}", here):
            assert client.get(path).json()["id"] == made.json()["id"]
        assert client.get("/motion/openapi.json").json()["servers"] == [{"url": "/motion"}]
        assert client.get("/motion/health/live").status_code == 200
        page = client.get("/motion/view/" + "0" * 64).text
        [name] = re.findall(r'import\("([^"]+)"', page)
        assert name.startswith("/motion/viewer/")
        assert client.get(name).status_code == 200
        # Of the page that describes the interface by its own address.
        assert "url: 'openapi.json'" in client.get("/motion/docs").text
        for path in ("/motionless/v1/sequences", "/motion/motion/v1/sequences"):
            assert client.get(path).status_code == 404


@pytest.mark.parametrize("prefix", ["motion", "/", "/motion/", "/a b", "//a"])
def test_what_is_no_prefix_is_refused(prefix: str) -> None:
    with pytest.raises(ValidationError, match="path_prefix"):
        Settings(path_prefix=prefix)
