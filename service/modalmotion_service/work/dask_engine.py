"""Work on several machines, through a Dask scheduler; for training and batches.

Whoever reaches the scheduler can run code on its workers and in the service, as with any Dask: keep
its port among your own machines, or use TLS with certificates of your own.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future, InvalidStateError
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

from modalmotion.errors import needs_extra
from modalmotion.store.disk import make_folder
from modalmotion_service.errors import ClusterError
from modalmotion_service.settings import Settings
from modalmotion_service.work.answers import AnswerError, error_to_bytes, from_bytes, result_type
from modalmotion_service.work.engine import READY_SECONDS, Engine, Terms, payload_of, run_payload
from modalmotion_service.work.pool import WorkerPool, unreadable_answer

P = ParamSpec("P")
T = TypeVar("T")

Limits = tuple[float, int]

_MARK: Final = "cluster"
# Dask workers that may be lost with a task.
_ATTEMPTS: Final = 3

# Of a Dask worker: its pools, by their limits.
_pools: Final[dict[Limits, WorkerPool]] = {}
_making: Final = threading.Lock()


class DaskEngine(Engine):
    """Tasks on the workers of a Dask scheduler.

    Each Dask worker hands them to a `WorkerPool` of its own, so that limits, confinement and deaths
    of processes are those of one machine. A task that has begun ends by its limits alone. While the
    scheduler is lost tasks fail with ClusterError, which puts jobs back into the queue.

    Parameters
    ----------
    settings : Settings

    Raises
    ------
    ClusterError
        If there is no scheduler, it has no worker, or one cannot do the work.
    """

    def __init__(self, settings: Settings) -> None:
        with needs_extra("cluster"):
            import distributed

        self._distributed = distributed
        self._scheduler = settings.scheduler or ""
        self._seconds = settings.cluster_seconds
        self._limits = (settings.task_seconds, settings.task_memory_bytes)
        self._mark = settings.data_dir.absolute() / _MARK
        make_folder(self._mark)
        self._lock = threading.Lock()
        self._under_way: set[Future[Any]] = set()
        self._is_open = True
        self._client = self._connected()

    @property
    def n_workers(self) -> int:
        """Threads of all workers, as the scheduler last said."""
        workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
        return max(1, sum(int(one["nthreads"]) for one in workers))

    @property
    def n_waiting(self) -> Mapping[str, int]:
        """Tasks beyond those that all workers do at once."""
        return {"short": 0, "long": max(0, len(self._under_way) - self.n_workers)}

    @property
    def are_parsers_confined(self) -> None:
        """Workers on other machines know it of themselves."""
        return

    def require_ready(self) -> None:
        """Raise ClusterError while there is no scheduler, or no worker that can do the work."""
        self._require_workers(self._reached(), READY_SECONDS)

    def submit_for(
        self, terms: Terms, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs
    ) -> Future[T]:
        """Run a task on some worker."""
        if not self._is_open:
            raise RuntimeError("The executor takes no more tasks.")
        future: Future[T] = Future()
        try:
            executor = self._reached().get_executor(pure=False, retries=_ATTEMPTS - 1)
            work = executor.submit(
                work_here,
                *(payload_of(terms, fn, args, kwargs), terms),
                *(self._limits, self._mark, version("modalmotion")),
            )
        except ClusterError as error:
            future.set_exception(error)
            return future
        self._under_way.add(future)

        def settle(done: Future[bytes]) -> None:
            with contextlib.suppress(InvalidStateError):
                # Errors of the task come as bytes.
                if done.cancelled() or done.exception() is not None:
                    future.set_exception(self._is_lost())
                    return
                try:
                    future.set_result(from_bytes(done.result(), result_type(fn)))
                except AnswerError:
                    future.set_exception(unreadable_answer())
                except BaseException as error:  # noqa: BLE001 (it is the task's)
                    future.set_exception(error)

        def forget(_: Future[T]) -> None:
            self._under_way.discard(future)
            if future.cancelled():
                work.cancel()

        future.add_done_callback(forget)
        work.add_done_callback(settle)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more tasks; finish those under way, or give them up if asked to."""
        self._is_open = False
        for future in list(self._under_way):
            if cancel_futures or not wait:
                future.cancel()
            else:
                with contextlib.suppress(BaseException):
                    future.result()
        self._client.close()

    def _reached(self) -> Any:
        """Give the client, a new one where the scheduler was lost and is back."""
        with self._lock:
            if self._client.status != "running":
                with contextlib.suppress(TimeoutError, OSError):
                    self._client.close(timeout=1)
                self._client = self._connected(READY_SECONDS)
            return self._client

    def _connected(self, seconds: float | None = None) -> Any:
        seconds = self._seconds if seconds is None else seconds
        try:
            client = self._distributed.Client(
                self._scheduler, set_as_default=False, timeout=seconds
            )
        except (OSError, ValueError) as error:
            raise ClusterError(
                f"There is no scheduler at '{self._scheduler}': {error}.",
                remedy="Start it, or correct MODALMOTION_SCHEDULER.",
            ) from error
        try:
            self._require_workers(client, seconds)
        except BaseException:
            client.close()
            raise
        return client

    def _require_workers(self, client: Any, seconds: float) -> None:
        try:
            client.wait_for_workers(1, timeout=seconds)
        except (OSError, ValueError) as error:
            raise ClusterError(
                f"The scheduler at '{self._scheduler}' has no workers.",
                remedy="Start workers at this address, as docs/operations.md has it.",
            ) from error

    def _is_lost(self) -> ClusterError:
        return ClusterError(
            f"The scheduler at '{self._scheduler}' cannot be reached, or gave the work up.",
            remedy="Try again soon; an operator should look after the scheduler and its workers.",
        )


def work_here(payload: bytes, terms: Terms, limits: Limits, mark: Path, expected: str) -> bytes:
    """Do a task in a pool of this Dask worker; gives its answer, be it an error."""
    try:
        _require_here(mark, expected)
        return _pool(*limits).submit_for(terms, run_payload, payload).result()
    except BaseException as error:  # noqa: BLE001 (whatever it is, whoever waits is told)
        return error_to_bytes(error)


def _require_here(mark: Path, expected: str) -> None:
    """Raise ClusterError on a machine where work could not be done rightly."""
    if (here := version("modalmotion")) != expected:
        raise ClusterError(
            f"A worker runs modalmotion {here}, and {expected} sends work.",
            remedy="Run the same version (image) everywhere: results could differ.",
        )
    if not mark.is_dir():
        raise ClusterError(
            f"A worker does not see the data folder '{mark.parent}'.",
            remedy="Mount the same volume under the same path for the service and each worker.",
        )


def _pool(seconds: float, memory_bytes: int) -> WorkerPool:
    from distributed import get_worker

    with _making:
        if (seconds, memory_bytes) not in _pools:
            n_threads = get_worker().state.nthreads
            _pools[seconds, memory_bytes] = WorkerPool(n_threads, seconds, memory_bytes)
        return _pools[seconds, memory_bytes]
