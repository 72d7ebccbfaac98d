"""Tests of the service again, with its work on the workers of a scheduler."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import LIMIT_BYTES
from dask_cluster import DaskCluster
from fastapi.testclient import TestClient
from test_codec_routes import *  # noqa: F403
from test_jobs import *  # noqa: F403

from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings


@pytest.fixture
def client(data_dir: Path, dask_cluster: DaskCluster) -> Iterator[TestClient]:
    settings = Settings(
        data_dir=data_dir,
        scheduler=dask_cluster.address,
        max_body_bytes=LIMIT_BYTES,
        max_frames=100,
        wait_seconds=120.0,
    )
    with TestClient(create_app(settings), raise_server_exceptions=False) as client:
        metered = client.app.state.owners.local.analysis.engine  # type: ignore[attr-defined]
        assert type(metered.engine).__name__ == "DaskExecutor"
        yield client
