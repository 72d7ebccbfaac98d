"""A model that is trained on the workers of a scheduler."""

from __future__ import annotations

from pathlib import Path

import pytest
from dask_cluster import DaskCluster
from distributed import Client
from fastapi.testclient import TestClient
from services import served
from training_cohort import cohort, send, train

from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings


@pytest.mark.thorough
def test_a_model_trained_on_the_workers_is_the_one_of_one_machine(
    dask_cluster: DaskCluster, tmp_path: Path
) -> None:
    settings = Settings(
        data_dir=tmp_path / "cluster", scheduler=dask_cluster.address, wait_seconds=120.0
    )
    options = {"folds": 2, "repetitions": 1, "estimator": "linear", "card": "quick"}
    with (
        Client(dask_cluster.address, set_as_default=False) as dask,
        served(settings) as client,
    ):

        def n_done() -> int:
            return sum(dask.run(lambda dask_worker: dask_worker.state.executed_count).values())

        ids = send(client, cohort(3, seed=8))
        before = n_done()
        there = train(client, "anywhere", ids, options=options)
        # Six signatures; then reading them, two folds, and the whole.
        assert n_done() - before == 6 + 1 + 2 + 1
    with TestClient(create_app(Settings(data_dir=tmp_path / "alone"))) as alone:
        send(alone, cohort(3, seed=8))
        here = train(alone, "anywhere", ids, options=options)
    assert here["id"] == there["id"]
