"""Turns of owners at a cluster's workers: what is not sent yet waits here, and not there."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from typing import Final

from modalmotion_service.work.fair_queue import FairQueue
from modalmotion_service.work.lanes import SHORT_SECONDS
from modalmotion_service.work.terms import NO_TERMS, Terms

Ticket = asyncio.Future[None]

# Short tasks under way for each thread: the next one is there when one ends.
_AHEAD: Final = 2


def places_for_long(n_threads: int) -> int:
    """Threads of a worker that long work may take: one is left for short work, if it has two."""
    return max(1, n_threads - 1)


class Turns:
    """Lets tasks pass, owner by owner, as many at once as workers can do.

    Work of no owner, as a cohort's, passes at once: whoever sends it counts it. All calls come
    from one event loop.
    """

    def __init__(self) -> None:
        self._queues = {name: FairQueue[Ticket](_is_wanted) for name in ("short", "long")}
        self._most = {"short": _AHEAD, "long": 1}
        self._under_way = {"short": 0, "long": 0}

    @property
    def n_waiting(self) -> Mapping[str, int]:
        """Tasks that wait, by lane."""
        return {name: len(queue) for name, queue in self._queues.items()}

    def set_threads(self, n_threads: Sequence[int]) -> None:
        """Say how many threads each worker has."""
        self._most["short"] = max(1, _AHEAD * sum(n_threads))
        self._most["long"] = max(1, sum(map(places_for_long, n_threads)))
        self._let_pass()

    def give_up(self, error: Exception) -> None:
        """Fail all that wait."""
        for queue in self._queues.values():
            for ticket in filter(_is_wanted, queue.clear()):
                ticket.set_exception(error)

    @asynccontextmanager
    async def turn(self, terms: Terms) -> AsyncIterator[None]:
        """Wait for the turn of a task, and have it until the block ends."""
        if terms == NO_TERMS:
            yield
            return
        lane = lane_of(terms)
        ticket: Ticket = asyncio.get_running_loop().create_future()
        self._queues[lane].put(ticket, terms.owner, terms.price)
        self._let_pass()
        try:
            await ticket
            yield
        finally:
            if ticket.done() and not ticket.cancelled() and ticket.exception() is None:
                self._under_way[lane] -= 1
                self._let_pass()

    def _let_pass(self) -> None:
        for lane, queue in self._queues.items():
            while self._under_way[lane] < self._most[lane]:
                ticket = queue.take()
                if ticket is None:
                    break
                self._under_way[lane] += 1
                ticket.set_result(None)


def lane_of(terms: Terms) -> str:
    """Name the lane of a task."""
    return "short" if terms.price <= SHORT_SECONDS else "long"


def _is_wanted(ticket: Ticket) -> bool:
    return not ticket.done()
