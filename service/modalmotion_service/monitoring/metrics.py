"""Metrics for Prometheus: requests, bytes, work, jobs, stores. No owner, no id, no path."""

import threading
import time
from collections import Counter as Tally
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from functools import partial
from importlib.metadata import version
from typing import Any, Final

from prometheus_client import CollectorRegistry, Counter, Histogram, Info, ProcessCollector
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

from modalmotion.errors import ModalMotionError, StoreError
from modalmotion_service.errors import ClusterError, NoWorkerError
from modalmotion_service.work.engine import Engine
from modalmotion_service.workspace.operation import State
from modalmotion_service.workspace.owners import Owners
from modalmotion_service.workspace.spool import require_room


def require_ready(local: State) -> None:
    """Check that there are workers, that the disk has room, and that the store answers.

    Parameters
    ----------
    local : State
        Of the data folder itself.

    Raises
    ------
    ClusterError, StoreError
        If not; both are answered 503.
    """
    try:
        local.analysis.engine.require_ready()
    except NoWorkerError:
        raise
    except ClusterError as error:
        # Everybody may ask: the error itself names a machine inside.
        raise ClusterError(
            "The machines that work is sent to cannot be used now.",
            remedy="Try again soon; the service's log names them.",
        ) from error
    try:
        require_room(local.store.root)
    except StoreError as error:
        # Never 507: nobody has sent anything.
        raise StoreError(error.message, remedy=error.remedy) from error
    local.store.list_sequences(limit=1)


_SECONDS: Final = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60, 300)


class Metrics:
    """Counters of one app, in a registry of their own."""

    def __init__(self) -> None:
        self.registry = own = CollectorRegistry()
        counter, route = partial(Counter, registry=own), ["route"]
        seconds = partial(Histogram, buckets=_SECONDS, registry=own)
        self.requests = counter(
            "modalmotion_requests", "Requests answered.", ["method", "route", "status"]
        )
        self.seconds = seconds(
            "modalmotion_request_seconds", "Time until an answer is complete.", ["method", "route"]
        )
        self.received = counter("modalmotion_received_bytes", "Bytes of requests' bodies.", route)
        self.sent = counter("modalmotion_sent_bytes", "Bytes of answers' bodies.", route)
        self.task_seconds = seconds(
            "modalmotion_task_seconds", "Time from handing work over until its result.", ["kind"]
        )
        self.tasks_failed = counter(
            "modalmotion_tasks_failed", "Work that ended in an error or was given up.", ["kind"]
        )
        build = Info("modalmotion_build", "The version that runs.", registry=own)
        build.info({"version": version("modalmotion")})
        # Memory, processor time and open files of the service's own process.
        ProcessCollector(registry=own)
        self._lock = threading.Lock()
        self._n_tasks = 0

    def count(
        self, method: str, route: str, status: int, seconds: float, n_received: int, n_sent: int
    ) -> None:
        """Count a request that was answered, and the bytes of its body and of the answer."""
        self.requests.labels(method, route, status).inc()
        self.seconds.labels(method, route).observe(seconds)
        self.received.labels(route).inc(n_received)
        self.sent.labels(route).inc(n_sent)

    @property
    def tasks_under_way(self) -> int:
        """Tasks that were handed to the workers and have no result yet."""
        return self._n_tasks

    def watch(self, kind: str, future: Future[Any]) -> None:
        """Count a task that was handed to the workers, by its name."""
        start = time.perf_counter()
        self._change_tasks(1)

        def count(done: Future[Any]) -> None:
            self._change_tasks(-1)
            self.task_seconds.labels(kind).observe(time.perf_counter() - start)
            if done.cancelled() or done.exception() is not None:
                self.tasks_failed.labels(kind).inc()

        future.add_done_callback(count)

    def _change_tasks(self, number: int) -> None:
        # They end in other threads.
        with self._lock:
            self._n_tasks += number


class StateOfThings(Collector):
    """Gauges that are read with each scrape: jobs, workers, stores, the disk.

    Parameters
    ----------
    owners : Owners
    metrics : Metrics
    engine : Engine
    """

    def __init__(self, owners: Owners, metrics: Metrics, engine: Engine) -> None:
        self._owners = owners
        self._metrics = metrics
        self._engine = engine

    def collect(self) -> Iterator[GaugeMetricFamily]:
        """Count, over all owners."""
        states, engine = list(self._owners.states.values()), self._engine
        jobs = _sum(state.jobs.count() for state in states)
        yield _gauge("jobs", "Jobs stored, by kind and state.", jobs, "kind", "state")
        stored = _sum(state.store.count() for state in states)
        yield _gauge("stored", "Things in the stores.", stored, "kind")
        n_workers, n_tasks = engine.n_workers, self._metrics.tasks_under_way
        # An engine that does not know the lanes does as many at once as it has workers.
        waiting = engine.n_waiting or {"short": 0, "long": max(0, n_tasks - n_workers)}
        yield _gauge(
            "tasks_waiting",
            "Tasks without a process yet: short work, and all other.",
            {(lane,): length for lane, length in waiting.items()},
            "lane",
        )
        busy = max(0, n_tasks - sum(waiting.values()))
        for name, meaning, value in (
            ("ready", "Whether results can be made and stored: 1 or 0.", self._is_ready()),
            ("owners", "Stores that are open.", len(states)),
            ("owners_failed", "Stores that cannot be opened.", self._owners.n_failed),
            ("workers", "Worker processes, but for that of the short lane.", n_workers),
            ("workers_busy", "Processes with a task, that of the short lane too.", busy),
            ("disk_free_bytes", "Free space of the data folder.", self._owners.free_bytes()),
        ):
            yield _gauge(name, meaning, {(): value})

    def _is_ready(self) -> bool:
        try:
            require_ready(self._owners.local)
        except ModalMotionError:
            return False
        return True


def _sum(counts: Iterable[Mapping[Any, int]]) -> Mapping[Sequence[str], float]:
    total: Tally[Any] = Tally()
    for count in counts:
        total.update(count)
    return {(key,) if isinstance(key, str) else key: number for key, number in total.items()}


def _gauge(
    name: str, meaning: str, values: Mapping[Sequence[str], float], *labels: str
) -> GaugeMetricFamily:
    gauge = GaugeMetricFamily(f"modalmotion_{name}", meaning, labels=labels)
    for its, value in values.items():
        gauge.add_metric(its, value)
    return gauge
