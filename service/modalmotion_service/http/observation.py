"""Where the time of a request went, by stage."""

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar

_stages: ContextVar[dict[str, float] | None] = ContextVar("stages", default=None)


def begin_stages() -> dict[str, float]:
    """Start to collect milliseconds by stage in this context."""
    collected: dict[str, float] = {}
    _stages.set(collected)
    return collected


@contextmanager
def stage(name: str) -> Iterator[None]:
    """Add the time of the block to a stage of the request it belongs to."""
    start = time.perf_counter()
    try:
        yield
    finally:
        if (collected := _stages.get()) is not None:
            spent = 1e3 * (time.perf_counter() - start)
            collected[name] = collected.get(name, 0.0) + spent


def server_timing(spent_in: Mapping[str, float], total: float) -> str:
    """Write the header's value; `total` in milliseconds, and `other` of it in no stage."""
    other = max(0.0, total - sum(spent_in.values()))
    entries = [*spent_in.items(), *([("other", other)] if spent_in else []), ("total", total)]
    return ", ".join(f"{name};dur={spent:.1f}" for name, spent in entries)
