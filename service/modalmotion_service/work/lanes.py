"""The tasks that wait for a process, in two lanes: short work, and all other."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, replace
from typing import Any, Final

from modalmotion_service.work.engine import NO_TERMS, Terms
from modalmotion_service.work.fair_queue import FairQueue

SHORT_SECONDS: Final = 0.1
"""Price of the dearest task that is short work."""

LANE_SECONDS: Final = 0.5
"""What the process that is there for short work spends on a task before it gives it up."""

# An owner's prices are taken for so many times higher after one of their tasks has outlived the
# lane, and for half of that whenever so much time has passed.
_DEARER: Final = 4.0
_MOST_DEAR: Final = 256.0
_HALF_LIFE: Final = 60.0


@dataclass(eq=False)
class Task:
    """A task on its way through a pool.

    Parameters
    ----------
    future : Future
    function : callable
    request : bytes
        What its process is sent.
    attempts : int
        How often it may still be tried.
    seconds : float
        After which it is ended.
    terms : Terms
    """

    future: Future[Any]
    function: Callable[..., Any]
    request: bytes
    attempts: int
    seconds: float
    terms: Terms = NO_TERMS

    @property
    def looks_short(self) -> bool:
        """Whether it has a price; the rest is not for the lane to give up."""
        return self.terms.price < math.inf


class _Distrust:
    """By how much an owner's work is dearer than it looks, as was seen of late."""

    def __init__(self) -> None:
        self._seen: dict[str, tuple[float, float]] = {}

    def factor(self, owner: str) -> float:
        """Factor of the owner's prices, at least 1."""
        if owner not in self._seen:
            return 1.0
        factor, since = self._seen[owner]
        factor *= math.exp2((since - time.monotonic()) / _HALF_LIFE)
        if factor < 1.0:
            del self._seen[owner]
        return max(1.0, factor)

    def note(self, owner: str) -> None:
        """Note that a task of the owner was not the short one that it looked like."""
        factor = min(_DEARER * self.factor(owner), _MOST_DEAR)
        self._seen[owner] = (factor, time.monotonic())


class Lanes:
    """Tasks that wait, for any number of threads that take them.

    A worker takes whatever waits, long work first; the lane's own process takes short work alone.
    So short work never waits for long work to end, and where nothing long waits all processes
    do short work.
    """

    def __init__(self) -> None:
        lock = threading.Lock()
        self._queues = {name: FairQueue[Task](_is_wanted) for name in ("short", "long")}
        # Who waits for what: a task wakes one thread, and one that may take it.
        self._of_workers = threading.Condition(lock)
        self._of_lane = threading.Condition(lock)
        self._idle = {False: 0, True: 0}
        self._distrust = _Distrust()
        self._is_open = True

    def put(self, task: Task) -> bool:
        """Append a task; False if no more are taken."""
        with self._of_workers:
            if self._is_open:
                self._append(task)
            return self._is_open

    def put_back(self, task: Task) -> bool:
        """Append a task that has outlived the lane to the long ones; False if they are closed."""
        terms = task.terms
        with self._of_workers:
            self._distrust.note(terms.owner)
            if self._is_open:
                self._append(replace(task, terms=replace(terms, price=10 * LANE_SECONDS)))
            return self._is_open

    def take(self, question: Callable[[], Task | None], *, is_lane: bool) -> Task | None:
        """Wait for a task; None when there will be no more.

        Parameters
        ----------
        question : callable
            Gives what whoever takes is to do before anything else.
        is_lane : bool
        """
        condition = self._of_lane if is_lane else self._of_workers
        queues = ("short",) if is_lane else ("long", "short")
        with condition:
            while True:
                if (asked := question()) is not None:
                    return asked
                for name in queues:
                    if (task := self._queues[name].take()) is not None:
                        return task
                if not self._is_open:
                    return None
                self._idle[is_lane] += 1
                condition.wait()

    def have_look(self) -> None:
        """Have all who wait look whether they are asked something."""
        with self._of_workers:
            self._wake_all()

    def close(self, *, give_up: bool) -> list[Task]:
        """Take no more tasks; gives those that wait, if they are given up."""
        left: list[Task] = []
        with self._of_workers:
            self._is_open = False
            for queue in self._queues.values() if give_up else ():
                left += queue.clear()
            self._wake_all()
        return left

    @property
    def lengths(self) -> Mapping[str, int]:
        """Tasks that wait, by lane."""
        return {name: len(queue) for name, queue in self._queues.items()}

    def _wake_all(self) -> None:
        self._idle = {False: 0, True: 0}
        self._of_workers.notify_all()
        self._of_lane.notify_all()

    def _append(self, task: Task) -> None:
        terms = task.terms
        price = terms.price * self._distrust.factor(terms.owner)
        is_short = price <= SHORT_SECONDS
        self._queues["short" if is_short else "long"].put(task, terms.owner, price)
        # A worker that is idle before the lane, which can leave long work where it is.
        if self._idle[False]:
            self._idle[False] -= 1
            self._of_workers.notify()
        elif is_short and self._idle[True]:
            self._idle[True] -= 1
            self._of_lane.notify()


def _is_wanted(task: Task) -> bool:
    return not task.future.cancelled()
