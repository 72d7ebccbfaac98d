"""A service in a folder of its own."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dask_cluster import DaskCluster
from fastapi.testclient import TestClient
from training_cohort import N_PER_CLASS, Trained, cohort, send, train

from modalmotion.formats import write_npz
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings

LIMIT_BYTES = 2_000_000


def small_settings(data_dir: Path) -> Settings:
    # No answer becomes a job because the machine is busy.
    return Settings(
        data_dir=data_dir, max_body_bytes=LIMIT_BYTES, max_frames=100, wait_seconds=120.0
    )


@contextmanager
def served(settings: Settings) -> Iterator[TestClient]:
    # An error of the server must show as the answer that a client gets.
    with TestClient(create_app(settings), raise_server_exceptions=False) as client:
        yield client


@pytest.fixture
def fresh_data_dir(tmp_path: Path) -> Path:
    return tmp_path / "results"


@pytest.fixture
def fresh_client(fresh_data_dir: Path) -> Iterator[TestClient]:
    with served(small_settings(fresh_data_dir)) as client:
        yield client


# Fresh for each test, but in files that say otherwise.
@pytest.fixture
def data_dir(fresh_data_dir: Path) -> Path:
    return fresh_data_dir


@pytest.fixture
def client(fresh_client: TestClient) -> TestClient:
    return fresh_client


@pytest.fixture(scope="module")
def shared_data_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("shared") / "results"


@pytest.fixture(scope="module")
def shared_client(shared_data_dir: Path) -> Iterator[TestClient]:
    """One service for the tests of a file that do not hang on what others have sent."""
    with served(small_settings(shared_data_dir)) as client:
        yield client


@pytest.fixture(
    scope="module",
    params=["processes here", pytest.param("workers of a scheduler", marks=pytest.mark.thorough)],
)
def engine(request: pytest.FixtureRequest) -> str:
    """Where work is done: what asks for it is run once for each."""
    return str(request.param)


@pytest.fixture(scope="module")
def engine_data_dir(engine: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("engine") / "results"


@pytest.fixture(scope="module")
def engine_client(
    engine: str, engine_data_dir: Path, request: pytest.FixtureRequest
) -> Iterator[TestClient]:
    """One service for the tests of a file, with its work done by each engine in turn."""
    settings = small_settings(engine_data_dir)
    if engine != "processes here":
        cluster: DaskCluster = request.getfixturevalue("dask_cluster")
        settings = settings.model_copy(update={"engine": "dask", "scheduler": cluster.address})
    with served(settings) as client:
        used = client.app.state.owners.local.analysis.engine  # type: ignore[attr-defined]
        assert (type(used).__name__ == "DaskEngine") == (engine != "processes here")
        yield client


@pytest.fixture(scope="session")
def beat() -> bytes:
    """A simulated ventricle's beat, as a file."""
    rng = np.random.default_rng(7)
    noisy = Acquisition(noise=0.3)
    return write_npz(simulate_ventricle(grid=(8, 16), acquisition=noisy, rng=rng))


@pytest.fixture
def npz() -> Callable[..., bytes]:
    """Write arrays as an .npz file."""

    def write(**arrays: Any) -> bytes:
        buffer = io.BytesIO()
        np.savez(buffer, **arrays)
        return buffer.getvalue()

    return write


@pytest.fixture(scope="session")
def dask_cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskCluster]:
    """A scheduler and two workers that no test may kill."""
    cluster = DaskCluster(tmp_path_factory.mktemp("dask"))
    try:
        yield cluster.start(2)
    finally:
        cluster.stop()


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Trained]:
    """A service with a model that was trained on it, for the tests of models."""
    data_dir = tmp_path_factory.mktemp("models") / "results"
    app = create_app(Settings(data_dir=data_dir, workers=2, wait_seconds=120.0))
    with TestClient(app, raise_server_exceptions=False) as client:
        ids = send(client, cohort(N_PER_CLASS, seed=1))
        model = train(client, "wall-motion", ids, options={"repetitions": 2})
        yield Trained(client, data_dir, ids, model, list(cohort(2, seed=2)))


def files_of(folder: Path) -> set[str]:
    """Result files below a folder (not the index, which may grow by itself)."""
    return {str(path.relative_to(folder)) for path in folder.rglob("*.h5")}
