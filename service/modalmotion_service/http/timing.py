"""Where a request's time went, for the Server-Timing header (W3C Server Timing)."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar

_stages: ContextVar[dict[str, float] | None] = ContextVar("stages", default=None)


def begin() -> dict[str, float]:
    """Start to collect milliseconds by stage in this context."""
    stages: dict[str, float] = {}
    _stages.set(stages)
    return stages


@contextmanager
def stage(name: str) -> Iterator[None]:
    """Add the time of the block to a stage of the request it belongs to."""
    start = time.perf_counter()
    try:
        yield
    finally:
        add_milliseconds({name: 1e3 * (time.perf_counter() - start)})


def add_milliseconds(milliseconds: Mapping[str, float]) -> None:
    """Add times measured elsewhere, such as by a worker."""
    stages = _stages.get()
    if stages is not None:
        for name, spent in milliseconds.items():
            stages[name] = stages.get(name, 0.0) + spent


def header(stages: Mapping[str, float], total: float) -> str:
    """Write the header's value; `total` in milliseconds."""
    entries = [*stages.items(), ("total", total)]
    return ", ".join(f"{name};dur={spent:.1f}" for name, spent in entries)
