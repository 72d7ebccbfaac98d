"""Work on several machines, through a Dask scheduler; for training and batches.

Whoever reaches the scheduler can run code on its workers and in the service, as with any Dask: keep
its port among your own machines, or use TLS with certificates of your own.
"""

import contextlib
import pickle
import threading
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

from modalmotion.errors import needs_extra
from modalmotion.store.disk import make_folder
from modalmotion_service.errors import ClusterError
from modalmotion_service.settings import Settings
from modalmotion_service.work import answers, pool
from modalmotion_service.work.engine import READY_SECONDS, Engine, Terms

P = ParamSpec("P")
T = TypeVar("T")

# Dask workers that may be lost with a task, but for the last.
_RETRIES: Final = 2

# Of a Dask worker: its pools, by their limits.
_pools: Final[dict[tuple[float, int], pool.WorkerPool]] = {}
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
        If there is no scheduler, or it has no worker.
    """

    def __init__(self, settings: Settings) -> None:
        with needs_extra("cluster"):
            from distributed import Client

        self._open = Client
        self._scheduler = settings.scheduler or ""
        self._limits = (settings.task_seconds, settings.task_memory_bytes)
        self._mark = settings.data_dir.absolute() / "cluster" / version("modalmotion")
        make_folder(self._mark)
        self._lock = threading.Lock()
        self._connect(settings.cluster_seconds)

    @property
    def n_workers(self) -> int:
        """Threads of all workers, as the scheduler last said."""
        workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
        return max(1, sum(int(one["nthreads"]) for one in workers))

    def require_ready(self) -> None:
        """Raise ClusterError while there is no scheduler, or no worker."""
        self._executor_now()
        self._require_workers(READY_SECONDS)

    def submit_for(
        self, terms: Terms, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs
    ) -> Future[T]:
        """Run a task on some worker."""
        future: Future[T] = Future()
        payload = pickle.dumps((fn, args, kwargs))
        try:
            task = (payload, terms, self._limits, self._mark)
            work = self._executor_now().submit(answers.answer_of, _in_pool, task, {})
        except ClusterError as error:
            future.set_exception(error)
            return future

        def settle(done: Future[bytes]) -> None:
            with contextlib.suppress(InvalidStateError):
                # Errors of the task come as bytes.
                if done.cancelled() or done.exception() is not None:
                    future.set_exception(self._is_lost())
                    return
                try:
                    future.set_result(answers.from_bytes(done.result(), answers.result_type(fn)))
                except BaseException as error:  # noqa: BLE001 (it is the task's)
                    future.set_exception(error)

        future.add_done_callback(lambda _: future.cancelled() and work.cancel())
        work.add_done_callback(settle)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more tasks; finish those under way, or give them up if asked to."""
        self._executor.shutdown(wait=wait and not cancel_futures)
        self._client.close()

    def _executor_now(self) -> Any:
        """Give the executor, of a new client where the scheduler was lost and is back."""
        with self._lock:
            if self._client.status != "running":
                self._connect(READY_SECONDS)
            return self._executor

    def _connect(self, seconds: float) -> None:
        try:
            self._client = self._open(self._scheduler, set_as_default=False, timeout=seconds)
        except (OSError, ValueError) as error:
            raise self._is_lost() from error
        self._executor = self._client.get_executor(pure=False, retries=_RETRIES)
        self._require_workers(seconds)

    def _require_workers(self, seconds: float) -> None:
        try:
            self._client.wait_for_workers(1, timeout=seconds)
        except (OSError, ValueError) as error:
            raise self._is_lost() from error

    def _is_lost(self) -> ClusterError:
        return ClusterError(
            f"The scheduler at '{self._scheduler}' cannot be reached, has no workers, or gave the "
            "work up.",
            remedy="Try again soon; an operator should look after the scheduler, its workers and "
            "MODALMOTION_SCHEDULER.",
        )


def _in_pool(payload: bytes, terms: Terms, limits: tuple[float, int], mark: Path) -> Any:
    """Do a task in a pool of this Dask worker."""
    from distributed import get_worker

    if not (mark.is_dir() and mark.name == version("modalmotion")):
        raise ClusterError(
            f"A worker does not see the data folder '{mark.parents[1]}', or does not run "
            f"modalmotion {mark.name}.",
            remedy="Run the same image everywhere, with the same volume under the same path.",
        )
    with _making:
        if limits not in _pools:
            _pools[limits] = pool.WorkerPool(get_worker().state.nthreads, *limits)
    function, args, kwargs = pickle.loads(payload)  # noqa: S301 (sent by our own service)
    return _pools[limits].submit_for(terms, function, *args, **kwargs).result()
