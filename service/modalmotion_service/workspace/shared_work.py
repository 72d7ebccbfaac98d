"""Work that many may wait for, done once."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Hashable
from typing import Any, TypeVar

T = TypeVar("T")


class SharedWork:
    """Work under way, by what it makes.

    A request for a result that is being made waits for it. Work whose last waiter has gone
    is cancelled.
    """

    def __init__(self) -> None:
        self._tasks: dict[Hashable, asyncio.Task[Any]] = {}
        self._waiters: dict[Hashable, int] = {}

    async def join(self, key: Hashable, make: Callable[[], Awaitable[T]]) -> T:
        """Wait for the work of that key, begun now if nobody has."""
        task: asyncio.Task[T] | None = self._tasks.get(key)
        if task is None:
            task = asyncio.ensure_future(make())
            self._tasks[key] = task
            # From then on the result is in the store: the next request finds it there.
            task.add_done_callback(lambda _: self._tasks.pop(key, None))
        self._waiters[key] = self._waiters.get(key, 0) + 1
        try:
            # The shield lets one waiter go without taking the work from the others.
            return await asyncio.shield(task)
        except asyncio.CancelledError:
            if self._waiters[key] == 1 and not task.done():
                task.cancel()
                await asyncio.wait([task])
            raise
        finally:
            self._waiters[key] -= 1
            if not self._waiters[key]:
                del self._waiters[key]
