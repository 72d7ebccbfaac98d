"""Where work is done, behind the standard `Executor`: callers see no difference.

Engines are found by name as entry points `modalmotion.engines`, each a callable that takes the
settings and gives an `Engine`.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Final, ParamSpec, TypeVar

from modalmotion.errors import ParameterError
from modalmotion_service.settings import Settings

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
        """Whether its workers confine what parses HDF5 and VTK; None where only they know."""

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


def open_engine(settings: Settings) -> Engine:
    """Start the engine that the settings name: processes of this machine by default.

    Raises
    ------
    ParameterError
        If there is none of that name.
    ClusterError
        If it cannot be reached.
    """
    if settings.engine == "processes":
        from modalmotion_service.work.pool import WorkerPool

        limits = (settings.task_seconds, settings.task_memory_bytes)
        return WorkerPool(settings.workers, *limits, has_lane=True)
    for entry in entry_points(group="modalmotion.engines", name=settings.engine):
        engine: Engine = entry.load()(settings)
        return engine
    known = sorted(entry.name for entry in entry_points(group="modalmotion.engines"))
    raise ParameterError(
        f"MODALMOTION_ENGINE is {settings.engine!r}, and there is no such engine.",
        remedy=f"Set it to one of: {', '.join(['processes', *known])}.",
    )
