"""A pool of worker processes that cannot lose a task.

Each process has a keeper, a thread of this process, and each task that is under way has one keeper,
which does nothing but wait for the answer; see `WorkerProcess` for how each wait ends. So every
future settles, whatever is killed at whatever moment.
"""

import contextlib
import logging
import os
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future, InvalidStateError, wait
from functools import partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

from modalmotion.errors import LimitError, ParameterError
from modalmotion.store.disk import cannot_write, is_of_the_machine
from modalmotion_service.errors import ClusterError, CostError, NoWorkerError, WorkerDiedError
from modalmotion_service.settings import Settings
from modalmotion_service.work import answers, forks, upload, worker
from modalmotion_service.work.engine import LANE_SECONDS, READY_SECONDS, Engine, Lanes, Task, Terms

logger = logging.getLogger(__name__)

P = ParamSpec("P")
T = TypeVar("T")

ATTEMPTS: Final = 3
"""How often a task whose process died is tried."""
MOST_STARTS: Final = 5
"""Processes that are begun for one task until one of them starts."""


class Keeper(threading.Thread):
    """The thread that keeps one process, and one task at a time.

    Parameters
    ----------
    pool : WorkerPool
        Whose tasks it does.
    is_lane : bool
        Whether it takes short work alone, and gives up what is not.
    """

    def __init__(self, pool: "WorkerPool", *, is_lane: bool = False) -> None:
        super().__init__(name="keeper", daemon=True)
        self._pool, self._is_lane = pool, is_lane
        self._process: forks.WorkerProcess | None = None
        self._task: Task | None = None
        self._changing = threading.Lock()
        self._is_ending = False
        self.start()

    def end(self) -> None:
        """Have it end what is under way."""
        self._is_ending = True
        self._give_up(self._task)

    def look(self) -> bool | None:
        """Return whether its process can work: not while it is stopped; None if there is none.

        One that is stopped without a task is ended: there will be another one for the next task.
        """
        process, is_idle = self._process, self._task is None
        if process is None or not process.is_alive:
            return None
        if process.is_stopped:
            if is_idle:
                process.kill()
            return False
        return True

    def run(self) -> None:
        """Do tasks until there are no more."""
        try:
            if self._pool.has_lane:
                # The first one waits for all imports, before there is a task.
                with contextlib.suppress(forks.ProcessLostError):
                    self._require_process()
            while (task := self._pool.lanes.take(is_lane=self._is_lane)) is not None:
                with self._changing:
                    self._task = task
                self._do(task)
                with self._changing:
                    self._task = None
                del task
        finally:
            self._replace()

    def _give_up(self, task: Task | None) -> None:
        """End the process that is at work on a task, if it still is; else a look ends the wait."""
        with self._changing:
            # It may be replaced meanwhile.
            if task is not None and self._task is task and (process := self._process) is not None:
                process.kill()

    def _do(self, task: Task) -> None:
        """Run a task; its future is settled when this returns, or it is in the queue again."""

        def cancelled(future: Future[Any]) -> None:
            if future.cancelled():
                self._give_up(task)

        task.future.add_done_callback(cancelled)
        try:
            value = self._result(task)
        except forks.UnwantedError:
            task.future.cancel()
        except BaseException as error:  # noqa: BLE001 (all of them are the future's)
            if self._is_lane and task.looks_short and isinstance(error, forks.DeadlineError):
                self._pool.lanes.put_back(task)
                return
            with contextlib.suppress(InvalidStateError):
                task.future.set_exception(self._pool.explain(error, task))
        else:
            with contextlib.suppress(InvalidStateError):
                task.future.set_result(value)

    def _result(self, task: Task) -> Any:
        seconds = task.seconds
        if self._is_lane and task.looks_short:
            seconds = min(seconds, LANE_SECONDS)
        means, is_wanted = task.terms.most_seconds, partial(self._is_wanted, task)
        while True:
            process = self._living(task)
            try:
                answer = process.exchange(task.request(), seconds, means, is_wanted)
            except BaseException as error:
                # It may still be at work on this, and would answer the next task with it.
                self._replace()
                if not isinstance(error, forks.ProcessLostError):
                    raise
                self._require_wanted(task)
                task.attempts -= 1
                _log_death(task, process)
                if not task.attempts:
                    raise error from None
                continue
            try:
                return answers.from_bytes(answer, answers.result_type(task.function))
            except answers.AnswerError:
                # Whatever it is by now, it is not what was begun.
                self._replace()
                raise

    def _is_wanted(self, task: Task) -> bool:
        return not (self._is_ending or task.future.cancelled())

    def _require_wanted(self, task: Task) -> None:
        if not self._is_wanted(task):
            raise forks.UnwantedError

    def _living(self, task: Task) -> forks.WorkerProcess:
        """Give a process that lives; what was killed while it was idle costs no attempt."""
        for _ in range(MOST_STARTS):
            self._require_wanted(task)
            with contextlib.suppress(forks.ProcessLostError):
                process = self._require_process()
                # Who gave it up before could not tell which process to end.
                self._require_wanted(task)
                return process
        raise ClusterError(
            f"No process could be started for the work, {MOST_STARTS} times in a row.",
            remedy="Try again soon; an operator should look after memory and the limit on "
            "processes.",
            details={"tries": MOST_STARTS},
        )

    def _require_process(self) -> forks.WorkerProcess:
        if self._process is not None and not self._process.is_idle:
            self._replace()
        if self._process is None:
            is_batch = self._pool.has_lane and not self._is_lane
            self._process = forks.WorkerProcess(self._pool.memory_bytes, is_batch=is_batch)
        return self._process

    def _replace(self) -> None:
        if self._process is not None:
            self._process.end()
            self._process = None


def _log_death(task: Task, process: forks.WorkerProcess) -> None:
    code = forks.FORKS.exit_code(process.pid)
    logger.warning(
        "a process ended in the middle of its work",
        extra={
            "task": getattr(task.function, "__name__", "other"),
            # 9 is how the kernel ends what takes too much of the machine's memory.
            "signal": -code if code is not None and code < 0 else None,
            "exit_code": code if code is not None and code >= 0 else None,
            "attempts_left": task.attempts,
        },
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
    seconds_limit : str
        What errors call the limit on time.
    has_lane : bool
        Whether there is one process more, for short work alone. Then processes are begun before
        there is a task, and all but that one leave a core to what wakes up.
    """

    def __init__(
        self,
        n_workers: int,
        task_seconds: float,
        memory_bytes: int,
        seconds_limit: str = "task_seconds",
        *,
        has_lane: bool = False,
    ) -> None:
        self.memory_bytes, self.has_lane = memory_bytes, has_lane
        self.lanes = Lanes()
        self.are_parsers_confined = upload.are_confined()
        self._n_workers = n_workers
        self._task_seconds, self._seconds_limit = task_seconds, seconds_limit
        self._keepers = [Keeper(self) for _ in range(n_workers)]
        self._keepers += [Keeper(self, is_lane=True)] if has_lane else []

    @property
    def n_workers(self) -> int:
        """Processes, but for that of the lane."""
        return self._n_workers

    @property
    def n_waiting(self) -> Mapping[str, int]:
        """Tasks that wait for a process, by lane."""
        return self.lanes.lengths

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
            question = self.submit(os.getpid)
            wait([question], timeout=READY_SECONDS)
            if not question.cancel() and question.exception() is None:
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
        # Written by its keeper: of many cases that takes a while.
        request = partial(worker.payload_of, terms, fn, args, kwargs)
        task = Task(future, fn, request, ATTEMPTS, self._task_seconds, terms)
        if not self.lanes.put(task):
            raise RuntimeError("The worker pool takes no more tasks.")
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more tasks; finish those under way, or end them if asked to."""
        # Nobody is left who would start what waits.
        is_ending = cancel_futures or not wait
        for task in self.lanes.close(give_up=is_ending):
            task.future.cancel()
        if is_ending:
            for keeper in self._keepers:
                keeper.end()
        if wait:
            for keeper in self._keepers:
                keeper.join()

    def explain(self, error: BaseException, task: Task) -> BaseException:
        """Say what the error of a task means to whoever sent it."""
        remedy = "Send fewer frames or a coarser mesh, or have the limit raised."
        if isinstance(error, forks.DeadlineError):
            text = f"The work took longer than {self._task_seconds:g} s and was ended."
            limit, most = self._seconds_limit, self._task_seconds
            return LimitError(text, remedy=remedy, limit=limit, details={"most": most})
        if isinstance(error, MemoryError):
            text = f"The work needs more memory than the {self.memory_bytes} bytes it may take."
            limit, most = "task_memory_bytes", self.memory_bytes
            return LimitError(text, remedy=remedy, limit=limit, details={"most": most})
        if isinstance(error, forks.SpentError):
            most = round(task.terms.most_seconds, 1)
            return CostError(
                f"The work took more than {most:g} s of processor time, many times what a file "
                "of this size takes, and was ended.",
                remedy="Save the file anew with another program, or send it in another format, "
                "such as npz.",
                limit="task_cost_factor",
                details={"most": most},
            )
        if isinstance(error, (forks.ProcessLostError, answers.AnswerError)):
            is_lost = isinstance(error, forks.ProcessLostError)
            what = f"ended {ATTEMPTS} times in a row" if is_lost else "gave an unreadable answer"
            return WorkerDiedError(
                f"The process at work on this {what}.",
                remedy="The input may break a reader; try to send it in another format.",
            )
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
