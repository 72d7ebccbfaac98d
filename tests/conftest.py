"""Fixtures that every test may ask for."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
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
    warm_bridges,
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
    "warm_bridges",
]


# Other examples in each run. A machine that has others to serve is slow to make one, or to try it.
settings.register_profile(
    "tests",
    max_examples=30 * int(os.environ.get("SOAK", "1")),
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("tests")


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


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give long counts their time; keep what shares a costly fixture in one process.

    A file's tests stay together (`--dist loadgroup`), so that what it makes is made once; so do
    all files that use the tests' cluster, and all that use the trained service. What takes long
    comes first (`--no-loadscope-reorder`), so that no process ends long before the others.
    """
    items.sort(key=lambda item: next(i for i, part in enumerate(_ORDER) if part in item.nodeid))
    groups: dict[Path, str] = {}
    for item in items:
        used = set(getattr(item, "fixturenames", ()))
        for group, fixtures in _SHARED.items():
            if used & fixtures:
                groups.setdefault(item.path, group)
    for item in items:
        item.add_marker(pytest.mark.xdist_group(groups.get(item.path, item.location[0])))
        # The limit of all others is for tests that hang.
        if item.get_closest_marker("soak") and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(3600))


# Parts of names, in the order of the time that their tests take; all others come last.
_ORDER = (
    *("tests/service/work/dask/", "tests/service/test_", "tests/service/cohort/"),
    *("tests/service/", "tests/core/client/", "tests/test_", "tests/core/classification/"),
    *("tests/core/cli/", "tests/core/store/", "tests/core/codec/", ""),
)

# Fixtures of a session that take seconds.
_SHARED = {
    "cluster": {"dask_cluster", "engine_client", "warm_bridges"},
    "trained": {"trained"},
}
