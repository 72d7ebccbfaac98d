"""Lines of logs: JSON, and none of a flood.

Apart from what is logged, for processes that have no other part in the service.
"""

import json
import logging
import time
from typing import Final


class JsonFormatter(logging.Formatter):
    """One JSON object a line: time, level, logger, message, and what the call added."""

    _STANDARD: Final = frozenset(vars(logging.makeLogRecord({}))) | {"message", "color_message"}

    def format(self, record: logging.LogRecord) -> str:
        """Write a record as JSON."""
        line: dict[str, object] = {
            "time": time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
            + f".{int(record.msecs):03d}Z",
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        added = {name: value for name, value in vars(record).items() if name not in self._STANDARD}
        line.update(added)
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str)


class Seldom(logging.Filter):
    """Lets the same message of a logger pass once in a while.

    Out of open files, asyncio says so for each connection that waits, as fast as it can: 5 MB
    of log a second, until the disk is full too.

    Parameters
    ----------
    seconds : float
        Between two of the same kind.
    """

    def __init__(self, seconds: float = 10.0) -> None:
        super().__init__()
        self._seconds = seconds
        self._passed: dict[tuple[str, int], float] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether to write the record; records from one line of code are of one kind."""
        kind, now = (record.pathname, record.lineno), time.monotonic()
        if now - self._passed.get(kind, -self._seconds) < self._seconds:
            return False
        self._passed[kind] = now
        return True


LOG_CONFIG: Final = {
    "version": 1,
    "disable_existing_loggers": False,
    "formatters": {"json": {"()": JsonFormatter}},
    "filters": {"seldom": {"()": Seldom}},
    "handlers": {
        "stderr": {
            "class": "logging.StreamHandler",
            "formatter": "json",
            "stream": "ext://sys.stderr",
        }
    },
    "root": {"level": "INFO", "handlers": ["stderr"]},
    # uvicorn's own access log names paths and queries.
    "loggers": {"uvicorn.access": {"level": "CRITICAL"}, "asyncio": {"filters": ["seldom"]}},
}


def log_config(level: str) -> dict[str, object]:
    """Give the configuration of logs, from a level on: debug, info, warning or error."""
    return {**LOG_CONFIG, "root": {"level": level.upper(), "handlers": ["stderr"]}}
