"""Tests of the service again, with its work on the workers of a scheduler."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import LIMIT_BYTES, served
from dask_cluster import DaskCluster
from distributed import Client
from fastapi.testclient import TestClient
from test_codec_routes import *  # noqa: F403
from test_jobs import *  # noqa: F403
from training_cohort import cohort, send, train

from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings


@pytest.fixture(scope="module")  # type: ignore[no-redef]
def client(shared_data_dir: Path, dask_cluster: DaskCluster) -> Iterator[TestClient]:
    settings = Settings(
        data_dir=shared_data_dir,
        scheduler=dask_cluster.address,
        max_body_bytes=LIMIT_BYTES,
        max_frames=100,
        wait_seconds=120.0,
    )
    with served(settings) as client:
        metered = client.app.state.owners.local.analysis.engine  # type: ignore[attr-defined]
        assert type(metered.engine).__name__ == "DaskExecutor"
        yield client


def test_a_model_trained_on_the_workers_is_the_one_of_one_machine(
    client: TestClient, dask_cluster: DaskCluster, tmp_path: Path
) -> None:
    options = {"folds": 2, "estimator": "linear"}
    with Client(dask_cluster.address, set_as_default=False) as dask:

        def n_done() -> int:
            return sum(dask.run(lambda dask_worker: dask_worker.state.executed_count).values())

        ids = send(client, cohort(6, seed=8))
        before = n_done()
        there = train(client, "anywhere", ids, options=options)
        # Twelve signatures; then reading them, two folds, and the whole.
        assert n_done() - before == 12 + 1 + 2 + 1
    with TestClient(create_app(Settings(data_dir=tmp_path / "alone"))) as alone:
        send(alone, cohort(6, seed=8))
        here = train(alone, "anywhere", ids, options=options)
    assert here["id"] == there["id"]
