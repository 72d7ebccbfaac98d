"""Where work is done, behind the standard `Executor`, and whose work it is.

Workers serve all owners, and what is computed once for one would be there sooner for the next: from
the time of an answer one could tell whether another had sent the same surface.
"""

from __future__ import annotations

import inspect
import math
import pickle
import sys
from abc import abstractmethod
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import Any, Final, ParamSpec, TypeVar

from modalmotion_service.work.answers import to_bytes

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


# Of the program itself, or by paths, which are in one owner's folder.
_OF_NOBODY: Final = frozenset({"_load_shipped", "_reader", "result_type"})

_served: list[str] = []


def serve(owner: str, function: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """Do a task for an owner, in a worker, which first forgets what it knows of others."""
    # All formats, which the processes that only hand tasks on do without.
    from modalmotion_service.work.upload import end_parser

    if _served and _served[-1] != owner:
        for cache in remembering():
            cache.cache_clear()
        end_parser()
    _served[:] = [owner]
    return function(*args, **kwargs)


def remembering() -> list[Any]:
    """List the caches of our modules whose keys a user's data may have a part in."""
    ours = ("modalmotion", "modalmotion_service")
    modules = [one for name, one in list(sys.modules.items()) if name.partition(".")[0] in ours]
    values = [value for module in modules for value in list(vars(module).values())]
    return [value for value in values if hasattr(value, "cache_clear") and _depends(value)]


def _depends(cache: Any) -> bool:
    function = cache.__wrapped__
    return bool(inspect.signature(function).parameters) and function.__name__ not in _OF_NOBODY


def payload_of(terms: Terms, function: Callable[..., Any], args: Any, kwargs: Any) -> bytes:
    """Write a task, as one that says whose work it is where it is somebody's."""
    if terms.owner:
        function, args = serve, (terms.owner, function, *args)
    return pickle.dumps((function, args, kwargs))


def run_payload(payload: bytes) -> bytes:
    """Run a task in a disposable process, which imports no more than the task needs.

    Returns
    -------
    bytes
        The result, as `modalmotion_service.work.answers` writes it.
    """
    function, args, kwargs = pickle.loads(payload)  # noqa: S301 (sent by our own service)
    return to_bytes(function(*args, **kwargs))
