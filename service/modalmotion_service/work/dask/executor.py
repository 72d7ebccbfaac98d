"""Work on several machines, through a Dask scheduler, behind the same `Executor`."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import secrets
import threading
from collections.abc import Callable, Coroutine, Mapping
from concurrent.futures import CancelledError as FutureCancelled
from concurrent.futures import Future
from concurrent.futures import wait as wait_for_all
from importlib.metadata import version
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from distributed import Client, KilledWorker

from modalmotion_service.errors import ClusterError, NoWorkerError, WorkerDiedError
from modalmotion_service.work.answers import AnswerError, from_bytes, result_type
from modalmotion_service.work.dask.hearing import Hearing
from modalmotion_service.work.dask.tasks import PLUGIN, Mark, PoolLimits, PoolPlugin, run_in_pool
from modalmotion_service.work.dask.turns import Turns, lane_of, places_for_long
from modalmotion_service.work.executor import Engine
from modalmotion_service.work.payload import payload_of
from modalmotion_service.work.pool import READY_SECONDS, unreadable_answer
from modalmotion_service.work.terms import Terms

P = ParamSpec("P")
T = TypeVar("T")

logger = logging.getLogger(__name__)

MARK = "cluster"
_LOOK_SECONDS = 1.0
# A machine under load may be slow to answer; a connection that breaks is seen at once.
_ANSWER_SECONDS = 30.0


class _MovedError(Exception):
    """Work was taken from a worker, to be given to another one."""


class DaskExecutor(Engine):
    """Tasks on the workers of a Dask scheduler, as `WorkerPool` does them here.

    In each Dask worker a `WorkerPool` does the work: limits, errors and retries are its own.
    A scheduler that is lost fails what is under way with ClusterError, and is looked for until
    it returns; so is work for which there has been no worker for a while. A worker that is not
    heard of counts as none, and its work is given to another one.

    Parameters
    ----------
    scheduler : str
        Address such as tcp://host:8786, or tls:// with Dask's own settings for certificates.
    folder : Path
        Folder that every worker shares under this path; a small file in it is what they are
        known by.
    task_seconds, memory_bytes, attempts
        As for `WorkerPool`.
    connect_seconds : float
        How long to wait for the scheduler and its first worker.
    patience_seconds : float
        How long work waits while there is no worker.

    Raises
    ------
    ClusterError
        If there is no scheduler, no worker, or one that does not share the folder.
    """

    def __init__(
        self,
        scheduler: str,
        folder: Path,
        task_seconds: float,
        memory_bytes: int,
        attempts: int = 3,
        *,
        connect_seconds: float = 30.0,
        patience_seconds: float = 30.0,
    ) -> None:
        self._address = scheduler
        self._limits = PoolLimits(task_seconds, memory_bytes, attempts)
        self._connect_seconds = connect_seconds
        self._patience = patience_seconds
        self._mark = Mark(
            folder.absolute() / f"{MARK}.{secrets.token_hex(8)}", version("modalmotion")
        )
        self._lock = threading.Lock()
        self._futures: set[Future[Any]] = set()
        self._remotes: set[Any] = set()
        self._hearing = Hearing()
        self._asking: dict[str, asyncio.Task[Any]] = {}
        self._n_places = 0
        self._turns = Turns()
        self._client: Client | None = None
        self._is_open = True
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(
            target=self._loop.run_forever, name="dask-executor", daemon=True
        )
        self._thread.start()
        self._remove_marks()
        self._mark.path.touch()
        try:
            self._call(self._connect()).result()
        except BaseException:
            self._end()
            raise
        self._supervision = self._call(self._supervise())

    @property
    def n_workers(self) -> int:
        """Long tasks that all workers do at once, as they were last looked at."""
        return max(1, self._n_places)

    @property
    def n_waiting(self) -> Mapping[str, int]:
        """Tasks that have not been sent to a worker yet, by lane."""
        return self._turns.n_waiting

    def require_ready(self) -> None:
        """Raise ClusterError while there is no scheduler, or no worker that answers."""
        if self._client is None:
            raise self._is_lost()
        if not self._n_places:
            raise self._has_no_worker()
        if not self._call(self._ask(self._client)).result():
            raise NoWorkerError(
                f"None of the scheduler's workers answered within {READY_SECONDS:g} s.",
                remedy="Try again soon; an operator should look after the workers' machines.",
                details={"seconds": READY_SECONDS},
            )

    def submit_for(
        self, terms: Terms, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs
    ) -> Future[T]:
        """Run a task on some worker; cancelling the future ends its process there."""
        payload = payload_of(fn, args, kwargs)
        with self._lock:
            if not self._is_open:
                raise RuntimeError("The executor takes no more tasks.")
            future: Future[T] = self._call(self._run(terms, payload, result_type(fn)))
            self._futures.add(future)
        future.add_done_callback(self._forget)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more tasks; finish those under way, or end them if asked to."""
        with self._lock:
            was_open, self._is_open = self._is_open, False
            futures = list(self._futures)
        if not was_open:
            return
        if cancel_futures or not wait:
            for future in futures:
                future.cancel()
        else:
            wait_for_all(futures)
        self._supervision.cancel()
        with contextlib.suppress(FutureCancelled):
            self._supervision.result()
        self._end()

    def _call(self, coroutine: Coroutine[Any, Any, T]) -> Future[T]:
        return asyncio.run_coroutine_threadsafe(coroutine, self._loop)

    def _forget(self, future: Future[Any]) -> None:
        with self._lock:
            self._futures.discard(future)

    async def _ask(self, client: Client) -> bool:
        """Tell whether a worker says that it is there."""
        for address in self._hearing.heard:
            # One question at a time: one that is stopped keeps the last one for as long.
            if address not in self._asking:
                asking = asyncio.ensure_future(client.run(os.getpid, workers=[address]))
                self._asking[address] = asking
                asking.add_done_callback(lambda _, address=address: self._asking.pop(address))
        deadline, waiting = self._loop.time() + READY_SECONDS, set(self._asking.values())
        while waiting and (left := deadline - self._loop.time()) > 0:
            done, waiting = await asyncio.wait(
                waiting, timeout=left, return_when=asyncio.FIRST_COMPLETED
            )
            if any(not asked.cancelled() and asked.exception() is None for asked in done):
                return True
        return False

    async def _run(self, terms: Terms, payload: bytes, expected: object) -> Any:
        async with self._turns.turn(terms):
            return await self._done(terms, payload, expected)

    async def _done(self, terms: Terms, payload: bytes, expected: object) -> Any:
        while True:
            client = self._client
            if client is None:
                raise self._is_lost()
            remote = client.submit(
                run_in_pool,
                payload,
                self._limits,
                self._mark,
                terms,
                # Of tasks that wait for the same thread the short one is next.
                priority=1 if lane_of(terms) == "short" else 0,
                key=f"modalmotion-{secrets.token_hex(16)}",
                pure=False,
                workers=self._hearing.heard or None,
                # Those that come later do it too.
                allow_other_workers=bool(self._hearing.heard),
            )
            self._remotes.add(remote)
            with contextlib.suppress(_MovedError):
                return await self._result(remote, expected)

    async def _result(self, remote: Any, expected: object) -> Any:
        try:
            return from_bytes(await remote, expected)
        except FutureCancelled as error:
            # By us alone: asyncio's own exception of that name is another one.
            if remote not in self._remotes:
                raise _MovedError from error
            raise self._is_lost() from error
        except AnswerError as error:
            raise unreadable_answer() from error
        except KilledWorker as error:
            raise WorkerDiedError(
                "Several workers ended while they were at work on this.",
                remedy="The input may break a reader; try to send it in another format.",
            ) from error
        finally:
            self._remotes.discard(remote)
            # A worker that is still at it sees that its result is wanted no more.
            remote.release()

    async def _connect(self) -> None:
        deadline = self._loop.time() + self._connect_seconds
        client = Client(
            self._address,
            asynchronous=True,
            set_as_default=False,
            timeout=self._connect_seconds,
            name="modalmotion",
        )
        try:
            await client
        except (OSError, TimeoutError, ValueError) as error:
            # Left open it would want our loop when it is collected, which may be gone by then.
            await client.close(timeout=1.0)
            raise ClusterError(
                f"There is no scheduler at '{self._address}' "
                f"(tried for {self._connect_seconds:g} s): {error}",
                remedy="Start it, or correct the address (MODALMOTION_SCHEDULER).",
            ) from error
        try:
            await self._take_up(client, deadline - self._loop.time())
        except BaseException:
            await client.close()
            raise
        self._client = client

    async def _take_up(self, client: Client, seconds: float) -> None:
        try:
            await client.wait_for_workers(1, timeout=max(1.0, seconds))
        except TimeoutError as error:
            raise self._has_no_worker() from error
        answers = await client.run(self._mark.write_beside, on_error="return")
        for worker, answer in answers.items():
            if isinstance(answer, ClusterError):
                raise answer
            if isinstance(answer, BaseException):
                raise ClusterError(
                    f"The worker at {worker} cannot do our work: {type(answer).__name__}: {answer}",
                    remedy="Run workers with `modalmotion worker`, of this version.",
                ) from answer
        names = {str(name) for name in answers.values()}
        if missing := names - {path.name for path in self._mark.path.parent.iterdir()}:
            raise ClusterError(
                f"What {len(missing)} of {len(answers)} workers write to "
                f"'{self._mark.path.parent}' does not arrive here.",
                remedy="Mount the same volume under the same path everywhere.",
            )
        await client.register_plugin(PoolPlugin(self._limits), name=PLUGIN)
        self._n_places = await self._listen(client)

    async def _listen(self, client: Client) -> int:
        """Give how many long tasks workers that are heard of do; OSError without a scheduler."""
        if client.status != "running":
            raise OSError(f"the connection is {client.status}")
        said = await asyncio.wait_for(client.scheduler.identity(), _ANSWER_SECONDS)
        self._hearing.note(said["workers"], self._loop.time())
        threads = [said["workers"][address]["nthreads"] for address in self._hearing.heard]
        self._turns.set_threads(threads)
        return sum(map(places_for_long, threads))

    async def _move(self, client: Client) -> None:
        """Give what workers have that are not heard of to those that are."""
        silent = self._hearing.silent
        if not silent or not self._hearing.heard:
            return
        theirs = await asyncio.wait_for(
            client.scheduler.processing(workers=list(silent)), _ANSWER_SECONDS
        )
        keys = {key for several in theirs.values() for key in several}
        moved = [remote for remote in self._remotes if remote.key in keys]
        if moved:
            logger.warning("%d pieces of work are taken from a silent worker", len(moved))
            self._remotes.difference_update(moved)
            await client.cancel(moved, force=True)

    async def _supervise(self) -> None:
        without_worker = 0.0
        while True:
            await asyncio.sleep(_LOOK_SECONDS)
            if self._client is None:
                with contextlib.suppress(ClusterError, OSError):
                    await self._connect()
                    logger.warning("the scheduler at %s is back", self._address)
                continue
            try:
                self._n_places = await self._listen(self._client)
                await self._move(self._client)
            except (OSError, TimeoutError, FutureCancelled) as error:
                logger.error(  # noqa: TRY400 (met when a machine restarts: no traceback)
                    "the scheduler at %s is lost: %r", self._address, error
                )
                lost, self._client = self._client, None
                self._n_places = 0
                await lost.close(timeout=1.0)
                continue
            without_worker = 0.0 if self._n_places else without_worker + _LOOK_SECONDS
            if without_worker >= self._patience and self._remotes:
                logger.error("the scheduler at %s has no worker", self._address)
                self._turns.give_up(self._has_no_worker())
                await self._client.cancel(list(self._remotes), force=True)
                without_worker = 0.0

    def _end(self) -> None:
        async def close() -> None:
            if self._client is not None:
                await self._client.close(timeout=5.0)
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            # Dask's own may go on trying to connect whatever is asked of them.
            if others:
                await asyncio.wait(others, timeout=2.0)

        self._call(close()).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
        self._remove_marks()

    def _remove_marks(self) -> None:
        for path in self._mark.path.parent.glob(f"{MARK}.*"):
            path.unlink(missing_ok=True)

    def _is_lost(self) -> ClusterError:
        return ClusterError(
            f"The scheduler at '{self._address}' cannot be reached, or gave the work up.",
            remedy="Try again soon; an operator should look after the scheduler and its workers.",
        )

    def _has_no_worker(self) -> ClusterError:
        return ClusterError(
            f"The scheduler at '{self._address}' has no workers.",
            remedy="Start some: modalmotion worker ADDRESS.",
        )
