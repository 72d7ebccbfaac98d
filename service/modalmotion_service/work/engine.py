"""Where work is done, behind the standard `Executor`, and whose turn it is.

Tasks wait for a process in two lanes, short work and all other, and owners take turns.
"""

import math
import threading
import time
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from typing import Any, Final, Generic, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

PREFIX: Final = 8
"""Bytes of the length before a request and an answer, little-endian."""

READY_SECONDS: Final = 2.0
"""In which a process that does nothing must say that it is there."""


@dataclass(frozen=True)
class Terms:
    """On what terms a task is done.

    Parameters
    ----------
    owner : str
        Whose turn it takes: the folder of their store; empty for nobody's.
    price : float, s
        Processor time that an honest file of its size takes; infinite where nobody knows.
    most_seconds : float, s
        Processor time after which it is ended.
    """

    owner: str = ""
    price: float = math.inf
    most_seconds: float = math.inf


NO_TERMS: Final = Terms()
"""Of work of the service's own, which no owner asked for."""


class Engine(Executor):
    """An executor of tasks that says how much it does at once, and whether it can.

    Tasks are functions of a module, carry paths and small values, and may run twice.
    """

    watchers: tuple[Callable[[str, Future[Any]], None], ...] = ()
    """Told of each task of an owner: its name, and the future of its result."""

    def run(
        self, terms: Terms, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs
    ) -> Future[T]:
        """Run a task as `submit_for` does, and tell the watchers of it."""
        future = self.submit_for(terms, fn, *args, **kwargs)
        for watch in self.watchers:
            watch(getattr(fn, "__name__", "other"), future)
        return future

    @property
    @abstractmethod
    def n_workers(self) -> int:
        """Tasks that run at the same time."""

    @property
    def n_waiting(self) -> Mapping[str, int]:
        """Tasks that wait for a process, by lane: `short` and `long`; none where others know."""
        return {}

    are_parsers_confined: bool | None = None
    """Whether its workers confine what parses HDF5, MATLAB and images; None if only they know."""

    @abstractmethod
    def require_ready(self) -> None:
        """Raise ClusterError if a task could not be run now."""

    @abstractmethod
    def submit_for(
        self, terms: Terms, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs
    ) -> Future[T]:
        """Run a task on these terms; cancelling the future gives it up."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run a task of nobody's in particular; cancelling the future gives it up."""
        return self.submit_for(NO_TERMS, fn, *args, **kwargs)


SHORT_SECONDS: Final = 0.1
"""Price of the dearest task that is short work."""

LANE_SECONDS: Final = 0.5
"""What the process that is there for short work spends on a task before it gives it up."""

DISTRUST_SECONDS: Final = 60.0
"""After a task that has outlived the lane, its owner's next ones are all long work for so long."""


@dataclass(eq=False)
class Task:
    """A task on its way through a pool.

    Parameters
    ----------
    future : Future
    function : callable
    request : callable
        Makes what its process is sent.
    attempts : int
        How often it may still be tried.
    seconds : float
        After which it is ended.
    terms : Terms
    """

    future: Future[Any]
    function: Callable[..., Any]
    request: Callable[[], bytes]
    attempts: int
    seconds: float
    terms: Terms = NO_TERMS

    @property
    def looks_short(self) -> bool:
        """Whether it has a price; the rest is not for the lane to give up."""
        return self.terms.price < math.inf


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
        self._distrusted: dict[str, float] = {}
        self._is_open = True

    def put(self, task: Task) -> bool:
        """Append a task; False if no more are taken."""
        with self._of_workers:
            if self._is_open:
                self._append(task)
            return self._is_open

    def put_back(self, task: Task) -> None:
        """Append a task that has outlived the lane to the long ones, or give it up at the end."""
        terms = replace(task.terms, price=10 * LANE_SECONDS)
        self._distrusted[terms.owner] = time.monotonic() + DISTRUST_SECONDS
        if not self.put(replace(task, terms=terms)):
            task.future.cancel()

    def take(self, *, is_lane: bool) -> Task | None:
        """Wait for a task; None when there will be no more."""
        condition = self._of_lane if is_lane else self._of_workers
        queues = ("short",) if is_lane else ("long", "short")
        with condition:
            while True:
                for name in queues:
                    if (task := self._queues[name].take()) is not None:
                        return task
                if not self._is_open:
                    return None
                self._idle[is_lane] += 1
                condition.wait()

    def close(self, *, give_up: bool) -> list[Task]:
        """Take no more tasks; gives those that wait, if they are given up."""
        left: list[Task] = []
        with self._of_workers:
            self._is_open = False
            for queue in self._queues.values() if give_up else ():
                left += queue.clear()
            self._of_workers.notify_all()
            self._of_lane.notify_all()
        return left

    @property
    def lengths(self) -> Mapping[str, int]:
        """Tasks that wait, by lane."""
        with self._of_workers:
            return {name: len(queue) for name, queue in self._queues.items()}

    def _append(self, task: Task) -> None:
        owner, price = task.terms.owner, task.terms.price
        is_trusted = self._distrusted.get(owner, 0.0) <= time.monotonic()
        is_short = is_trusted and price <= SHORT_SECONDS
        self._queues["short" if is_short else "long"].put(task, owner, price)
        # A worker that is idle before the lane, which can leave long work where it is.
        if self._idle[False]:
            self._idle[False] -= 1
            self._of_workers.notify()
        elif is_short and self._idle[True]:
            self._idle[True] -= 1
            self._of_lane.notify()


def _is_wanted(task: Task) -> bool:
    return not task.future.cancelled()


# A task costs a turn however short it is, and no more than the longest that there may be.
_LEAST: Final = 1e-3
_MOST: Final = 300.0


class FairQueue(Generic[T]):
    """First come, first served for each owner; between owners, whoever has had least.

    Each owner has a clock, which their tasks advance by their prices as they are taken, and the
    owner whose clock is furthest behind is next (start-time fair queueing: Goyal, Vin and Cheng,
    1996). With equal prices this is round robin. Whoever was away starts with the others' time:
    nobody saves turns up.

    Parameters
    ----------
    is_wanted : callable
        Of an item whose turn has come: one that is not is dropped, and costs its owner nothing.
    """

    def __init__(self, is_wanted: Callable[[T], bool]) -> None:
        self._is_wanted = is_wanted
        self._waiting: dict[str, deque[tuple[float, T]]] = {}
        self._clocks: dict[str, float] = {}
        self._now = 0.0

    def put(self, item: T, owner: str, price: float) -> None:
        """Append an item to those of its owner; `price` in s."""
        if owner not in self._waiting:
            self._waiting[owner] = deque()
            self._clocks[owner] = max(self._clocks.get(owner, 0.0), self._now)
        self._waiting[owner].append((min(max(price, _LEAST), _MOST), item))

    def take(self) -> T | None:
        """Take the next item that is wanted; None if there is none."""
        while self._waiting:
            owner = min(self._waiting, key=self._clocks.__getitem__)
            price, item = self._waiting[owner].popleft()
            is_wanted = self._is_wanted(item)
            if is_wanted:
                self._now = self._clocks[owner]
                self._clocks[owner] += price
            if not self._waiting[owner]:
                del self._waiting[owner]
                self._forget()
            if is_wanted:
                return item
        return None

    def clear(self) -> list[T]:
        """Take all that is left, wanted or not."""
        left = [item for queue in self._waiting.values() for _, item in queue]
        self._waiting.clear()
        return left

    def __len__(self) -> int:
        return sum(map(len, self._waiting.values()))

    def _forget(self) -> None:
        # Those who have nothing here and are not ahead start anew as anybody does.
        self._clocks = {
            owner: clock
            for owner, clock in self._clocks.items()
            if owner in self._waiting or clock > self._now
        }
