"""Metrics for Prometheus: requests, bytes, work, jobs, stores. No owner, no id, no path."""

from __future__ import annotations

import threading
import time
from collections import Counter as Tally
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Future
from importlib.metadata import version
from typing import Any, Final, TypeVar

from prometheus_client import CollectorRegistry, Counter, Histogram, Info, ProcessCollector
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from modalmotion.errors import ModalMotionError, StoreError
from modalmotion_service.access.scopes import SCOPE_OF
from modalmotion_service.errors import ClusterError, NoWorkerError
from modalmotion_service.http.gate import route_of
from modalmotion_service.http.middleware import Middleware
from modalmotion_service.http.observation import CLIENT_GONE
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
            remedy="Try again soon; the service's log says which they are.",
        ) from error
    try:
        require_room(local.store.root)
    except StoreError as error:
        # Never 507: nobody has sent anything.
        raise StoreError(error.message, remedy=error.remedy) from error
    local.store.list_sequences(limit=1)


K = TypeVar("K")

_METHODS: Final = frozenset(method for method, _ in SCOPE_OF) | {"HEAD", "OPTIONS", "PUT"}
_SECONDS: Final = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60, 300)


class Metrics:
    """Counters of one app, in a registry of their own."""

    def __init__(self) -> None:
        self.registry = own = CollectorRegistry()
        self.requests = Counter(
            "modalmotion_requests",
            "Requests answered.",
            ["method", "route", "status"],
            registry=own,
        )
        self.seconds = Histogram(
            "modalmotion_request_seconds",
            "Time until an answer is complete.",
            ["method", "route"],
            buckets=_SECONDS,
            registry=own,
        )
        self.received = Counter(
            "modalmotion_received_bytes", "Bytes of requests' bodies.", ["route"], registry=own
        )
        self.sent = Counter(
            "modalmotion_sent_bytes", "Bytes of answers' bodies.", ["route"], registry=own
        )
        self.task_seconds = Histogram(
            "modalmotion_task_seconds",
            "Time from handing work to the workers until its result.",
            ["kind"],
            buckets=_SECONDS,
            registry=own,
        )
        self.tasks_failed = Counter(
            "modalmotion_tasks_failed",
            "Work that ended in an error or was given up.",
            ["kind"],
            registry=own,
        )
        Info("modalmotion_build", "The version that runs.", registry=own).info(
            {"version": version("modalmotion")}
        )
        # Memory, processor time and open files of the service's own process.
        ProcessCollector(registry=own)
        self._lock = threading.Lock()
        self._n_tasks = 0

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


class Meter(Middleware):
    """ASGI middleware that counts requests.

    Parameters
    ----------
    app : ASGIApp
    metrics : Metrics
    """

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        super().__init__(app)
        self.metrics = metrics

    async def pass_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on and count it when it is answered."""
        start = time.perf_counter()
        status, n_received, n_sent = 500, 0, 0

        async def received() -> Message:
            nonlocal n_received
            message = await receive()
            n_received += len(message.get("body", b""))
            return message

        async def sent(message: Message) -> None:
            nonlocal status, n_sent
            status = message.get("status", status)
            n_sent += len(message.get("body", b""))
            await send(message)

        try:
            await self.app(scope, received, sent)
        except ClientDisconnect:
            status = CLIENT_GONE
            raise
        finally:
            # All methods and routes that clients make up count as "other".
            method = scope["method"] if scope["method"] in _METHODS else "other"
            route = route_of(scope) or "other"
            self.metrics.requests.labels(method, route, status).inc()
            self.metrics.seconds.labels(method, route).observe(time.perf_counter() - start)
            self.metrics.received.labels(route).inc(n_received)
            self.metrics.sent.labels(route).inc(n_sent)


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
        states = list(self._owners.states.values())
        jobs = GaugeMetricFamily(
            "modalmotion_jobs", "Jobs stored, by kind and state.", labels=["kind", "state"]
        )
        stored = GaugeMetricFamily("modalmotion_stored", "Things in the stores.", labels=["kind"])
        for (kind, job_state), number in _sum(state.jobs.count() for state in states):
            jobs.add_metric([kind, job_state], number)
        for name, number in _sum(state.store.count() for state in states):
            stored.add_metric([name], number)
        waiting = GaugeMetricFamily(
            "modalmotion_tasks_waiting",
            "Tasks without a process yet: short work, and all other.",
            labels=["lane"],
        )
        lengths = self._engine.n_waiting
        for lane, length in lengths.items():
            waiting.add_metric([lane], length)
        yield from (jobs, waiting, stored)
        busy = max(0, self._metrics.tasks_under_way - sum(lengths.values()))
        for name, meaning, value in (
            ("ready", "Whether results can be made and stored: 1 or 0.", self._is_ready()),
            ("owners", "Stores that are open.", len(states)),
            ("owners_failed", "Stores that cannot be opened.", self._owners.n_failed),
            (
                "workers",
                "Worker processes, but for that of the short lane.",
                self._engine.n_workers,
            ),
            ("workers_busy", "Processes with a task, that of the short lane too.", busy),
            ("disk_free_bytes", "Free space of the data folder.", self._owners.free_bytes()),
        ):
            yield GaugeMetricFamily(f"modalmotion_{name}", meaning, value)

    def _is_ready(self) -> bool:
        try:
            require_ready(self._owners.local)
        except ModalMotionError:
            return False
        return True


def _sum(counts: Iterable[Mapping[K, int]]) -> list[tuple[K, int]]:
    total: Tally[K] = Tally()
    for count in counts:
        total.update(count)
    return list(total.items())
