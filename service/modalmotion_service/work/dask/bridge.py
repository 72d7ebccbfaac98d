"""The process between the service and a scheduler, the only one that Dask speaks to.

Dask's client unpickles what a scheduler or a worker sends, so whoever owns one of them owns the
process of the client too. That is this one: it has no connection of a user and no secret, and
what it tells the service is read as a stranger's (see `answers`).
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging.config
import socket
import sys
from collections.abc import Coroutine
from typing import Any

from modalmotion_service.errors import ClusterError
from modalmotion_service.log_lines import log_config
from modalmotion_service.work.answers import error_to_bytes
from modalmotion_service.work.dask.frames import PIECE, Frame, Frames, Kind
from modalmotion_service.work.dask.logs import log_dask_as_json
from modalmotion_service.work.dask.scheduler import Scheduler
from modalmotion_service.work.dask.settings import ClusterSettings
from modalmotion_service.work.terms import read_terms


class Bridge:
    """Frames to tasks for a scheduler, and answers to frames.

    Parameters
    ----------
    settings : ClusterSettings
    reader, writer
        They lead to the service.
    """

    def __init__(
        self,
        settings: ClusterSettings,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
    ) -> None:
        self._reader = reader
        self._writer = writer
        self._scheduler = Scheduler(settings)
        self._say_seconds = settings.look_seconds
        self._tasks: dict[int, asyncio.Task[None]] = {}

    async def run(self) -> None:
        """Work until the service is gone."""
        try:
            await self._scheduler.connect()
        except ClusterError as error:
            self._say(Frame(Kind.REFUSAL, 0, error_to_bytes(error)))
            await self._writer.drain()
            return
        always = [
            asyncio.create_task(self._scheduler.supervise()),
            asyncio.create_task(self._say_state()),
        ]
        try:
            with contextlib.suppress(OSError):
                await self._listen()
        finally:
            for task in (*always, *self._tasks.values()):
                task.cancel()
            await self._scheduler.close()

    async def _listen(self) -> None:
        frames = Frames(sys.maxsize)
        while piece := await self._reader.read(PIECE):
            for frame in frames.add(piece):
                number = frame.number
                if frame.kind is Kind.TASK:
                    self._begin(number, self._do(number, frame.body))
                elif frame.kind is Kind.QUESTION:
                    self._begin(number, self._say_ready(number))
                elif frame.kind is Kind.CANCEL and number in self._tasks:
                    self._tasks[number].cancel()

    def _begin(self, number: int, work: Coroutine[Any, Any, None]) -> None:
        task = self._tasks[number] = asyncio.create_task(work)
        task.add_done_callback(lambda _: self._tasks.pop(number))

    async def _do(self, number: int, payload: bytes) -> None:
        try:
            answer = await self._scheduler.run(*read_terms(payload))
        except Exception as error:  # noqa: BLE001 (all of them are the sender's)
            answer = error_to_bytes(error)
        self._say(Frame(Kind.ANSWER, number, answer))

    async def _say_ready(self, number: int) -> None:
        is_ready = await self._scheduler.is_ready()
        self._say(Frame(Kind.READY, number, b"yes" if is_ready else b""))

    async def _say_state(self) -> None:
        while True:
            n_places, waiting = self._scheduler.n_places, self._scheduler.n_waiting
            state = "" if n_places is None else f"{n_places} {waiting['short']} {waiting['long']}"
            self._say(Frame(Kind.STATE, 0, state.encode()))
            await asyncio.sleep(self._say_seconds)

    def _say(self, frame: Frame) -> None:
        if not self._writer.is_closing():
            self._writer.write(frame.to_bytes())


async def _run(settings: ClusterSettings, ours: socket.socket) -> None:
    await Bridge(settings, *await asyncio.open_unix_connection(sock=ours)).run()


def main() -> None:
    """Run with a socket's number, a level of logs and the settings as arguments."""
    number, level, settings = sys.argv[1:]
    logging.config.dictConfig(log_config(level))
    log_dask_as_json()
    asyncio.run(_run(ClusterSettings(**json.loads(settings)), socket.socket(fileno=int(number))))


if __name__ == "__main__":
    main()
