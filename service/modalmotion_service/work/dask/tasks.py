"""What runs inside a Dask worker: a pool of disposable processes, and tasks handed to it.

Tasks arrive pickled and are unpickled in a process of the pool, so that they meet the limits
on time and memory, the death of a process and cancellation exactly as on one machine, and the
Dask worker itself reads nothing that a user sent.
"""

from __future__ import annotations

import os
import secrets
import socket
import threading
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import wait
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from distributed import Worker, WorkerPlugin, get_worker
from distributed.core import Status

from modalmotion_service.errors import ClusterError
from modalmotion_service.work.dask.turns import places_for_long
from modalmotion_service.work.payload import run_payload
from modalmotion_service.work.terms import Terms

if TYPE_CHECKING:
    from modalmotion_service.work.pool import WorkerPool

PLUGIN: Final = "modalmotion-pools"
# Pools that are kept for limits that tasks may come with again.
_MOST_UNUSED: Final = 2
# How soon the work of a task that nobody wants any more is ended.
_LOOK_SECONDS = 0.1

# When nobody waits for what a worker does.
_ENDED: Final = (Status.closing, Status.closed, Status.failed)


@dataclass(frozen=True)
class PoolLimits:
    """Limits of each task.

    Parameters
    ----------
    seconds : float
    memory_bytes : int
    attempts : int
    """

    seconds: float
    memory_bytes: int
    attempts: int


class Pools:
    """Pools of processes, one for each set of limits that tasks come with.

    Those that are at work are never more than the worker's threads; of the others the last few
    that were used are kept, and the rest closed.

    Parameters
    ----------
    n_threads : int
        Of the worker. One of them is left for short work, and so is one process of each pool;
        a single one does both.
    """

    def __init__(self, n_threads: int) -> None:
        self._n_threads = n_threads
        self._lock = threading.Lock()
        # In order of their last use.
        self._pools: dict[PoolLimits, WorkerPool] = {}
        self._n_users: Counter[PoolLimits] = Counter()

    @contextmanager
    def pool(self, limits: PoolLimits) -> Iterator[WorkerPool]:
        """Give a pool with these limits, which stays open as long as the block."""
        with self._lock:
            pool = self._pools.pop(limits, None)
            if pool is None:
                # Here, so that the bridge, which only names tasks, need not import what they need.
                from modalmotion_service.work.pool import WorkerPool

                pool = WorkerPool(
                    places_for_long(self._n_threads),
                    *(limits.seconds, limits.memory_bytes, limits.attempts),
                    has_lane=self._n_threads > 1,
                )
            self._pools[limits] = pool
            self._n_users[limits] += 1
        try:
            yield pool
        finally:
            with self._lock:
                self._n_users[limits] -= 1
                unused = [other for other in self._pools if not self._n_users[other]]
                closing = [self._pools.pop(other) for other in unused[:-_MOST_UNUSED]]
            for other_pool in closing:
                other_pool.shutdown(wait=False)

    def close(self) -> None:
        """End all of them."""
        with self._lock:
            pools = list(self._pools.values())
            self._pools.clear()
        for pool in pools:
            pool.shutdown(wait=False, cancel_futures=True)

    def __len__(self) -> int:
        return len(self._pools)


class PoolPlugin(WorkerPlugin):  # type: ignore[misc]
    """Pools of processes in every worker, with one for each of its threads.

    Parameters
    ----------
    limits : PoolLimits
        That the first tasks will come with.
    """

    # Several clients ask for it; the second must not end the first one's tasks.
    idempotent = True
    name = PLUGIN
    pools: Pools

    def __init__(self, limits: PoolLimits) -> None:
        self._limits = limits

    def setup(self, worker: Worker) -> None:
        """Make the first pool, and have its processes import what tasks need."""
        self.pools = Pools(worker.state.nthreads)
        with self.pools.pool(self._limits) as pool:
            for _ in range(worker.state.nthreads):
                pool.submit(os.getpid)

    def teardown(self, worker: Worker) -> None:  # noqa: ARG002 (Dask passes it by name)
        """End the pools with the worker."""
        self.pools.close()


@dataclass(frozen=True)
class Mark:
    """A file by which workers see that they share the data folder.

    Parameters
    ----------
    path : Path
    version : str
        Of this package, at the process that sends work.
    """

    path: Path
    version: str

    def require_here(self) -> None:
        """Raise ClusterError on a machine where work could not be done rightly."""
        here = socket.gethostname()
        if _version() != self.version:
            raise ClusterError(
                f"The worker on '{here}' runs modalmotion {_version()}, and work is sent by "
                f"{self.version}: results could differ, or not be understood.",
                remedy="Run the same version (image) everywhere.",
            )
        if not self.path.is_file():
            raise ClusterError(
                f"The worker on '{here}' does not see the data folder '{self.path.parent}'.",
                remedy="Mount the same volume under the same path for the service and for "
                "every worker.",
            )

    def write_beside(self) -> str:
        """Write a file where the mark lies; gives its name.

        Raises
        ------
        ClusterError
            If this worker cannot.
        """
        self.require_here()
        path = self.path.with_suffix(f".{secrets.token_hex(8)}")
        try:
            path.touch()
        except OSError as error:
            raise ClusterError(
                f"The worker on '{socket.gethostname()}' cannot write to the data folder "
                f"'{self.path.parent}': {error.strerror}.",
                remedy="Mount the volume for writing, and run workers as the service's user.",
            ) from error
        return path.name


def run_in_pool(payload: bytes, limits: PoolLimits, mark: Mark, terms: Terms) -> bytes:
    """Run a task that came as bytes in a pool of this worker's; gives its result as bytes.

    Raises
    ------
    ClusterError
        If this worker does not share the data folder, or ends before the task does.
    """
    mark.require_here()
    worker = get_worker()
    key = worker.get_current_task()
    plugin: Any = worker.plugins[PLUGIN]
    with plugin.pools.pool(limits) as pool:
        future = pool.submit_for(terms, run_payload, payload)
        while not wait([future], timeout=_LOOK_SECONDS).done:
            state = worker.state.tasks.get(key)
            is_released = state is None or state.state == "cancelled"
            # A worker that has lost its scheduler would wait half a minute for its threads.
            if is_released or worker.status in _ENDED:
                future.cancel()
                break
    if future.cancelled():
        # Read by nobody, or by a client that sends the task again.
        raise ClusterError("The work was given up.", remedy="Try again.")
    result: bytes = future.result()
    return result


@lru_cache(maxsize=1)
def _version() -> str:
    return version("modalmotion")
