"""Where the time of a request went, by stage."""

from __future__ import annotations

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
    """Add the time of the block to a stage of the request it belongs to.

    What stages inside it take is theirs alone, so that all of them add up to what was waited.
    """
    start, before = time.perf_counter(), _sum()
    try:
        yield
    finally:
        spent = 1e3 * (time.perf_counter() - start)
        # Never below 0: stages of several tasks may run at the same time.
        add_milliseconds({name: max(0.0, spent - (_sum() - before))})


def _sum() -> float:
    return sum((_stages.get() or {}).values())


def add_milliseconds(milliseconds: Mapping[str, float]) -> None:
    """Add times measured elsewhere, such as by a worker; those below 0 name parts of a stage."""
    collected = _stages.get()
    if collected is not None:
        for name, spent in milliseconds.items():
            # Tasks that run at the same time may have more parts than their stage has waited.
            collected[name] = max(0.0, collected.get(name, 0.0) + spent)


def server_timing(spent_in: Mapping[str, float], total: float) -> str:
    """Write the header's value; `total` in milliseconds, and `other` of it in no stage."""
    other = max(0.0, total - sum(spent_in.values()))
    entries = [*spent_in.items(), *([("other", other)] if spent_in else []), ("total", total)]
    return ", ".join(f"{name};dur={spent:.1f}" for name, spent in entries)
