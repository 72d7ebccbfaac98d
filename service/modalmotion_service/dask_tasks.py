"""What runs inside a Dask worker: a pool of disposable processes, and tasks handed to it.

Tasks arrive pickled and are unpickled in a process of the pool, so that they meet the limits
on time and memory, the death of a process and cancellation exactly as on one machine, and the
Dask worker itself reads nothing that a user sent.
"""

from __future__ import annotations

import os
import pickle
import secrets
import socket
from concurrent.futures import wait
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from distributed import Worker, WorkerPlugin, get_worker

from modalmotion_service.errors import ClusterError
from modalmotion_service.executor import WorkerPool

# How soon the work of a task that nobody wants any more is ended.
_LOOK_SECONDS = 0.1


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

    @property
    def name(self) -> str:
        """Name of the pool that holds these limits."""
        return f"modalmotion-{self.seconds:g}-{self.memory_bytes}-{self.attempts}"


class PoolPlugin(WorkerPlugin):  # type: ignore[misc]
    """A pool of processes in every worker, one for each of its threads.

    Parameters
    ----------
    limits : PoolLimits
    """

    # Several clients may ask for the same pool; the second must not end the first one's tasks.
    idempotent = True
    pool: WorkerPool

    def __init__(self, limits: PoolLimits) -> None:
        self.name = limits.name
        self._limits = limits

    def setup(self, worker: Worker) -> None:
        """Make the pool, and have its processes import what tasks need."""
        limits = self._limits
        self.pool = WorkerPool(
            worker.state.nthreads, limits.seconds, limits.memory_bytes, limits.attempts
        )
        for _ in range(worker.state.nthreads):
            self.pool.submit(os.getpid)

    def teardown(self, worker: Worker) -> None:  # noqa: ARG002 (Dask passes it by name)
        """End the pool with the worker."""
        self.pool.shutdown(wait=False, cancel_futures=True)


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


def run_in_pool(payload: bytes, pool_name: str, mark: Mark) -> bytes:
    """Run a pickled task in this worker's pool; gives its pickled result.

    Raises
    ------
    ClusterError
        If this worker does not share the data folder, or ends before the task does.
    """
    mark.require_here()
    worker = get_worker()
    key = worker.get_current_task()
    plugin: Any = worker.plugins[pool_name]
    future = plugin.pool.submit(run_pickled, payload)
    while not wait([future], timeout=_LOOK_SECONDS).done:
        state = worker.state.tasks.get(key)
        if state is None or state.state == "cancelled":
            future.cancel()
            break
    if future.cancelled():
        # Read by nobody, or by a client that sends the task again.
        raise ClusterError("The work was given up.", remedy="Try again.")
    result: bytes = future.result()
    return result


def run_pickled(payload: bytes) -> bytes:
    """Do what a payload says, in a disposable process."""
    function, args, kwargs = pickle.loads(payload)  # noqa: S301 (sent by our own service)
    return pickle.dumps(function(*args, **kwargs))


@lru_cache(maxsize=1)
def _version() -> str:
    return version("modalmotion")
