"""Logs do not fill disks."""

from __future__ import annotations

import logging

from modalmotion_service.log_lines import LOG_CONFIG, Seldom


def test_the_same_complaint_is_logged_seldom_and_others_all_the_same() -> None:
    def record(line: int) -> logging.LogRecord:
        return logging.LogRecord("asyncio", logging.ERROR, "events.py", line, "text", (), None)

    seldom = Seldom(seconds=60.0)
    assert [seldom.filter(record(line)) for line in (1, 1, 2, 1, 2)] == [
        *(True, False, True, False, False)
    ]
    often = Seldom(seconds=0.0)
    assert all(often.filter(record(1)) for _ in range(3))
    # The one whose complaints fill disks.
    assert LOG_CONFIG["loggers"]["asyncio"] == {"filters": ["seldom"]}  # type: ignore[index]
