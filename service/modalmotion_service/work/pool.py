"""A pool of worker processes that cannot lose a task.

Each process has a keeper, a thread of this process, and each task that is under way has one
keeper, which does nothing but wait: for the answer, for the end of the process, for the task's
deadline or the end of its means, or for the word that nobody wants it any more. One of these
comes, so every future settles, whatever is killed at whatever moment.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import Future, wait
from importlib.metadata import entry_points
from pathlib import Path
from typing import ParamSpec, TypeVar

from modalmotion.errors import LimitError, ParameterError
from modalmotion.store.disk import cannot_write, is_of_the_machine
from modalmotion_service.errors import CostError, NoWorkerError, WorkerDiedError
from modalmotion_service.settings import Settings
from modalmotion_service.work.answers import AnswerError
from modalmotion_service.work.engine import READY_SECONDS, Engine, Terms, payload_of
from modalmotion_service.work.keeper import (
    DeadlineError,
    Keeper,
    ProcessLostError,
    Rules,
    SpentError,
)
from modalmotion_service.work.lanes import Lanes, Task
from modalmotion_service.work.upload import are_confined

P = ParamSpec("P")
T = TypeVar("T")


def unreadable_answer() -> WorkerDiedError:
    """Make the error for a process that answers what no task of ours would."""
    return WorkerDiedError(
        "The process at work on this gave an answer that cannot be read.",
        remedy="The input may break a reader; try to send it in another format.",
    )


class WorkerPool(Engine):
    """Processes with a limit on time and on memory for each task.

    Parameters
    ----------
    n_workers : int
    task_seconds : float
        After this a task's process is ended, and its future fails with LimitError.
    memory_bytes : int
        Address space of each process; a task that needs more fails with LimitError.
    attempts : int
        How often a task whose process died is tried.
    seconds_limit : str
        What errors call the limit on time.
    has_lane : bool
        Whether there is one process more, for short work alone.
    is_eager : bool
        Whether processes are begun before there is a task.
    """

    def __init__(
        self,
        n_workers: int,
        task_seconds: float,
        memory_bytes: int,
        attempts: int = 3,
        seconds_limit: str = "task_seconds",
        *,
        has_lane: bool = False,
        is_eager: bool = True,
    ) -> None:
        self._task_seconds = task_seconds
        self._attempts = attempts
        self._seconds_limit = seconds_limit
        self._n_workers = n_workers
        self._lanes = Lanes()
        self._rules = rules = Rules(
            memory_bytes, self._explain, is_batch=has_lane, is_eager=is_eager
        )
        self._keepers = [Keeper(self._lanes, rules) for _ in range(n_workers)]
        if has_lane:
            self._keepers.append(Keeper(self._lanes, rules, is_lane=True))

    @property
    def n_workers(self) -> int:
        """Processes, but for that of the lane."""
        return self._n_workers

    @property
    def n_waiting(self) -> Mapping[str, int]:
        """Tasks that wait for a process, by lane."""
        return self._lanes.lengths

    @property
    def are_parsers_confined(self) -> bool:
        """Whether its processes confine what parses HDF5 and VTK."""
        return are_confined()

    def require_ready(self) -> None:
        """Check that a process is there that no signal has stopped, or that one can be begun.

        One that was stopped while it was idle is ended. That of the lane counts for short work
        alone, so it does not count.

        Raises
        ------
        NoWorkerError
            If there is none.
        """
        found = [keeper.look() for keeper in self._keepers[: self._n_workers]]
        if True in found:
            return
        if False not in found:
            question = Task(Future(), os.getpid, b"", 1, READY_SECONDS)
            self._lanes.put(question)
            wait([question.future], timeout=READY_SECONDS)
            if not question.future.cancel() and question.future.exception() is None:
                return
        raise NoWorkerError(
            f"None of the {self.n_workers} worker processes is ready to work.",
            remedy="Those that are stuck are replaced: try again soon. If it stays so, look after "
            "the machine's memory and its limit on processes.",
            details={"workers": self.n_workers},
        )

    def submit_for(
        self, terms: Terms, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs
    ) -> Future[T]:
        """Run a task in a worker; cancelling the future ends its process."""
        future: Future[T] = Future()
        request = payload_of(terms, fn, args, kwargs)
        task = Task(future, fn, request, self._attempts, self._task_seconds, terms)
        if not self._lanes.put(task):
            raise RuntimeError("The worker pool takes no more tasks.")
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more tasks; finish those under way, or end them if asked to."""
        # Nobody is left who would start what waits.
        is_ending = cancel_futures or not wait
        for task in self._lanes.close(give_up=is_ending):
            task.future.cancel()
        if is_ending:
            for keeper in self._keepers:
                keeper.end()
        if wait:
            for keeper in self._keepers:
                keeper.join()

    def _explain(self, error: BaseException, task: Task) -> BaseException:
        """Say what the error of a task means to whoever sent it."""
        if isinstance(error, DeadlineError):
            most = self._task_seconds
            return LimitError(
                f"The work took longer than {most:g} s and was ended.",
                remedy="Send fewer frames or a coarser mesh, ask for fewer modes, or have the "
                "limit raised.",
                limit=self._seconds_limit,
                details={"most": most},
            )
        if isinstance(error, SpentError):
            most = round(task.terms.most_seconds, 1)
            return CostError(
                f"The work took more than {most:g} s of processor time, many times what a file "
                "of this size takes, and was ended.",
                remedy="Save the file anew with another program, or send it in another format, "
                "such as npz.",
                limit="task_cost_factor",
                details={"most": most},
            )
        if isinstance(error, MemoryError):
            memory_bytes = self._rules.memory_bytes
            return LimitError(
                f"The work needs more memory than the {memory_bytes} bytes it may take.",
                remedy="Send fewer frames or a coarser mesh, or have the limit raised.",
                limit="task_memory_bytes",
                details={"most": memory_bytes},
            )
        if isinstance(error, ProcessLostError):
            return WorkerDiedError(
                f"The process at work on this ended {self._attempts} times in a row.",
                remedy="The input may break a reader; try to send it in another format.",
            )
        if isinstance(error, AnswerError):
            return unreadable_answer()
        if isinstance(error, OSError) and is_of_the_machine(error):
            return cannot_write(Path(error.filename or "a file of the work"), error)
        return error


def open_engine(settings: Settings) -> Engine:
    """Start the engine that the settings name: processes of this machine by default.

    Others are found as entry points `modalmotion.engines`, each a callable that takes the settings
    and gives an `Engine`.

    Raises
    ------
    ParameterError
        If there is none of that name.
    ClusterError
        If it cannot be reached.
    """
    if settings.engine == "processes":
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
