"""What Dask logs is a line of JSON as all else."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import dask
import pytest

from modalmotion_service.work.dask.logs import log_dask_as_json

pytest.importorskip("distributed")
NAMES = ("distributed", "distributed.client", "tornado.application")


@pytest.fixture
def loggers() -> Iterator[list[logging.Logger]]:
    """As Dask leaves them when it is imported, and as they were afterwards."""
    found = [logging.getLogger(name) for name in NAMES]
    before = [(logger, list(logger.handlers), logger.propagate) for logger in found]
    for logger in found:
        logger.handlers[:] = [logging.StreamHandler()]
        logger.propagate = False
    yield found
    for logger, handlers, propagate in before:
        logger.handlers[:], logger.propagate = handlers, propagate


def test_dask_logs_through_the_root(
    loggers: list[logging.Logger], caplog: pytest.LogCaptureFixture
) -> None:
    log_dask_as_json()
    assert not any(logger.handlers for logger in loggers)
    for logger in loggers:
        logger.error("lost")
    assert [record.name for record in caplog.records] == list(NAMES)


def test_what_an_operator_has_told_dask_stays(loggers: list[logging.Logger]) -> None:
    with dask.config.set({"logging": {"distributed": "debug"}}):
        log_dask_as_json()
    assert all(logger.handlers for logger in loggers)
    assert not any(logger.propagate for logger in loggers)
