"""Work that many may wait for, done once."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Hashable
from typing import Any, TypeVar

from modalmotion.progress import StageReport

T = TypeVar("T")


def unheard(_share: float, _text: str = "") -> None:
    """Report progress to nobody."""


class SharedWork:
    """Work under way, by what it makes.

    A request for a result that is being made waits for it. Work whose last waiter has gone
    is cancelled.
    """

    def __init__(self) -> None:
        self._tasks: dict[Hashable, asyncio.Task[Any]] = {}
        self._waiters: dict[Hashable, list[StageReport]] = {}

    async def join(
        self,
        key: Hashable,
        make: Callable[[StageReport], Awaitable[T]],
        report: StageReport = unheard,
    ) -> T:
        """Wait for the work of that key, begun now if nobody has.

        Parameters
        ----------
        key : hashable
        make : async function
            Does the work; called with a function that tells all who wait how far it is.
        report : callable
            Called with the share that is done, and with what is done now.
        """
        task: asyncio.Task[T] | None = self._tasks.get(key)

        def tell(share: float, text: str = "") -> None:
            for waiter in self._waiters.get(key, ()):
                waiter(share, text)

        if task is None:
            task = asyncio.ensure_future(make(tell))
            self._tasks[key] = task
            # From then on the result is in the store: the next request finds it there.
            task.add_done_callback(lambda _: self._tasks.pop(key, None))
        waiters = self._waiters.setdefault(key, [])
        waiters.append(report)
        try:
            # The shield lets one waiter go without taking the work from the others.
            return await asyncio.shield(task)
        except asyncio.CancelledError:
            if len(waiters) == 1 and not task.done():
                task.cancel()
                await asyncio.wait([task])
            raise
        finally:
            waiters.remove(report)
            if not waiters and self._waiters.get(key) is waiters:
                del self._waiters[key]
