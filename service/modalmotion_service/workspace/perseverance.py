"""Going on after faults that pass: a disk that is full, a store that is away for a while."""

from __future__ import annotations

import asyncio
import logging
import random
import sqlite3
from collections.abc import Awaitable, Callable, Iterator
from typing import Final

from modalmotion.errors import StoreError
from modalmotion.store.disk.atomic import is_of_the_machine
from modalmotion_service.errors import ClusterError

logger = logging.getLogger(__name__)

# Between one try and the next. Not longer: when the disk has room again, work goes on at once.
_FIRST_SECONDS: Final = 0.5
_LAST_SECONDS: Final = 5.0

# What fails in the background is tried again no later than this.
_AGAIN_SECONDS: Final = 60.0


def passes(error: BaseException) -> bool:
    """Tell whether a fault may be gone by itself: of the disk, of the index, of a cluster.

    Files that are missing, damaged or not understood stay so, and so do wrong parameters: these
    are errors below StoreError, or others.
    """
    if type(error) is StoreError or isinstance(error, (ClusterError, MemoryError, sqlite3.Error)):
        return True
    # As Python says that the system has no more threads.
    no_thread = isinstance(error, RuntimeError) and "can't start new thread" in str(error)
    return no_thread or is_of_the_machine(error)


def waits() -> Iterator[float]:
    """Seconds before each further try: longer and longer, and never for many at the same time."""
    seconds = _FIRST_SECONDS
    while True:
        yield seconds * random.uniform(0.8, 1.2)  # noqa: S311 (no secret)
        seconds = min(2 * seconds, _LAST_SECONDS)


async def for_ever(name: str, work: Callable[[], Awaitable[object]], seconds: float) -> None:
    """Do something now and again, whatever becomes of it.

    Parameters
    ----------
    name : str
        What the log calls it.
    work : async function
    seconds : float
        Between two times; after a failure a minute at most.
    """
    wait = seconds
    while True:
        await asyncio.sleep(wait)
        try:
            await work()
        except Exception as error:  # noqa: BLE001 (whatever it is, the next time comes)
            logger.error(  # noqa: TRY400 (its name says enough, and it may hold a path)
                "work in the background failed",
                extra={"work": name, "error": type(error).__name__},
            )
            wait = min(seconds, _AGAIN_SECONDS)
        else:
            wait = seconds
