"""Events that are noted together, in their order."""

from __future__ import annotations

import abc
import asyncio

from modalmotion_service.audit.entry import Event


class Notes(abc.ABC):
    """Where events are noted; while some are written, those that come wait for the next time."""

    def __init__(self) -> None:
        self._pending: list[tuple[Event, asyncio.Future[None]]] = []
        self._writing: asyncio.Task[None] | None = None

    @abc.abstractmethod
    def append(self, events: list[Event]) -> None:
        """Append events, all or none.

        Raises
        ------
        StoreError
            If they cannot be written.
        """

    @abc.abstractmethod
    async def look_after(self) -> None:
        """Do for ever what is to be done now and then."""

    async def note(self, event: Event) -> None:
        """Append an event; it is written when this returns.

        Raises
        ------
        StoreError
            If it cannot be written.
        """
        done: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._pending.append((event, done))
        if self._writing is None:
            self._writing = asyncio.create_task(self._write_pending())
        await done

    async def drain(self) -> None:
        """Wait until everything that was noted is written."""
        if self._writing is not None:
            await asyncio.wait([self._writing])

    async def _write_pending(self) -> None:
        try:
            while self._pending:
                batch, self._pending = self._pending, []
                try:
                    await asyncio.to_thread(self.append, [event for event, _ in batch])
                except BaseException as error:
                    for _, done in batch:
                        if not done.done():
                            done.set_exception(error)
                    if not isinstance(error, Exception):
                        raise
                else:
                    for _, done in batch:
                        if not done.done():
                            done.set_result(None)
        finally:
            self._writing = None
