"""Fixtures that every test may ask for."""

from __future__ import annotations

import gc
import os
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from project import DATA
from scheduling import FileScheduling
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
from shared_parser import shared_parsers
from xdist.remote import Producer

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
    "parsers",
    "real_data",
    "real_sequence",
    "rng",
    "shared_client",
    "shared_data_dir",
    "trained",
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


@pytest.fixture(scope="session", autouse=True)
def parsers() -> Iterator[None]:
    """One parser's process for the files of all tests."""
    with shared_parsers():
        yield


# Each process collects thousands of tests and imports everything, which stays to the end: looked
# through again and again for what can be freed, it took a quarter of the collection's time.
gc.disable()


def pytest_collection_finish() -> None:
    """Begin to free what tests leave; what was collected is looked at no more."""
    gc.collect()
    gc.freeze()
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave like cases to `make soak`; begin with what takes long (`--no-loadscope-reorder`).

    No process of several then ends long before the others.
    """
    seen: Counter[str] = Counter()
    for item in items:
        # Of many like cases some stand for all, which `make soak` runs.
        if mark := item.get_closest_marker("every"):
            test = item.nodeid.partition("[")[0]
            if seen[test] % mark.args[0]:
                item.add_marker(pytest.mark.thorough)
            seen[test] += 1
    items.sort(key=lambda item: next(i for i, part in enumerate(_ORDER) if part in item.nodeid))
    for item in items:
        # The limit of all others is for tests that hang.
        if item.get_closest_marker("soak") and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(3600))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> FileScheduling:
    """Keep together the tests that share what is costly to make."""
    return FileScheduling(config, log)


# Parts of names, in the order of the time that their tests take; all others come last.
_ORDER = (
    "tests/service/test_",
    "in_browser",
    *("tests/service/", "tests/core/client/", "tests/test_", "tests/core/classification/"),
    *("tests/core/cli/", "tests/core/store/", "tests/core/codec/", ""),
)
