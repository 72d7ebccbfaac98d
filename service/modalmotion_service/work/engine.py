"""Where work is done, behind the standard `Executor`: callers see no difference."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import Any, Final, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

READY_SECONDS: Final = 2.0
"""In which a process that does nothing must say that it is there."""


@dataclass(frozen=True)
class Terms:
    """On what terms a task is done.

    Parameters
    ----------
    owner : str
        Whose turn it takes.
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
    @abstractmethod
    def n_waiting(self) -> Mapping[str, int]:
        """Tasks that wait for a process, by lane: `short` and `long`."""

    @property
    @abstractmethod
    def are_parsers_confined(self) -> bool | None:
        """Whether its workers confine what parses HDF5 and VTK; None if only they know."""

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
