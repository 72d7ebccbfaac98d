"""Lines of Dask's own among the log's, in its form."""

from __future__ import annotations

import logging
from typing import Final

import dask

# Whose loggers Dask gives handlers of their own when it is imported.
_FAMILIES: Final = ("distributed", "bokeh", "tornado")


def log_dask_as_json() -> None:
    """Have Dask log through the root logger, unless an operator has told Dask how to log."""
    if any(dask.config.get(name, None) for name in ("logging", "logging-file-config")):
        return
    for name in list(logging.root.manager.loggerDict):
        if name.partition(".")[0] in _FAMILIES:
            logger = logging.getLogger(name)
            logger.handlers.clear()
            logger.propagate = True
