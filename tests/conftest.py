"""Fixtures that every test may ask for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from project import DATA
from services import (  # fixtures, which pytest finds here
    beat,
    client,
    dask_cluster,
    data_dir,
    engine,
    engine_client,
    engine_data_dir,
    fresh_client,
    fresh_data_dir,
    npz,
    shared_client,
    shared_data_dir,
    trained,
)

from modalmotion.formats import read_npz
from modalmotion.mesh.sequence import MeshSequence

__all__ = [
    "beat",
    "client",
    "dask_cluster",
    "data_dir",
    "engine",
    "engine_client",
    "engine_data_dir",
    "fresh_client",
    "fresh_data_dir",
    "npz",
    "real_data",
    "real_sequence",
    "rng",
    "shared_client",
    "shared_data_dir",
    "trained",
]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20_260_101)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of real sequences beside the project; tests that need it skip without it."""
    if not DATA.is_dir():
        pytest.skip("the folder of real sequences (../shared/data) is absent")
    return DATA


@pytest.fixture(scope="session")
def real_sequence(real_data: Path) -> Callable[[str], MeshSequence]:
    """Read a real sequence by its name, such as "heart/lv_endocardium"."""
    return lambda name: read_npz((real_data / f"{name}.npz").read_bytes()).sequence


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give long counts the time they need: the limit of all others is for tests that hang."""
    for item in items:
        if item.get_closest_marker("soak") and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(3600))
