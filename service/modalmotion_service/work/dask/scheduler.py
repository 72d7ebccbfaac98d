"""The client of a scheduler: it connects, hands work on, and looks after workers."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import secrets
from collections.abc import Mapping
from concurrent.futures import CancelledError as FutureCancelled
from pathlib import Path
from typing import Any, Final

from distributed import Client, KilledWorker

from modalmotion_service.errors import ClusterError, WorkerDiedError
from modalmotion_service.work.dask.hearing import Hearing
from modalmotion_service.work.dask.settings import ClusterSettings
from modalmotion_service.work.dask.tasks import PLUGIN, Mark, PoolLimits, PoolPlugin, run_in_pool
from modalmotion_service.work.dask.turns import Turns, lane_of, places_for_long
from modalmotion_service.work.executor import READY_SECONDS
from modalmotion_service.work.terms import Terms

logger = logging.getLogger(__name__)

# A machine under load may be slow to answer; a connection that breaks is seen at once.
_ANSWER_SECONDS: Final = 30.0


class _MovedError(Exception):
    """Work was taken from a worker, to be given to another one."""


class Scheduler:
    """A connection to a scheduler, made again when it is lost.

    A worker that is not heard of counts as none, and its work is given to another one.

    Parameters
    ----------
    settings : ClusterSettings
    """

    def __init__(self, settings: ClusterSettings) -> None:
        self._address = settings.scheduler
        self._settings = settings
        self._limits = PoolLimits(settings.task_seconds, settings.memory_bytes, settings.attempts)
        self._mark = Mark(Path(settings.mark), settings.version)
        self._remotes: set[Any] = set()
        self._hearing = Hearing(settings.silent_seconds)
        self._asking: dict[str, asyncio.Task[Any]] = {}
        self._n_places = 0
        self._turns = Turns()
        self._client: Client | None = None

    @property
    def n_places(self) -> int | None:
        """Long tasks that workers do at once, as last looked at; None without a scheduler."""
        return None if self._client is None else self._n_places

    @property
    def n_waiting(self) -> Mapping[str, int]:
        """Tasks whose turn has not come, by lane."""
        return self._turns.n_waiting

    async def is_ready(self) -> bool:
        """Tell whether a worker says that it is there."""
        client, loop = self._client, asyncio.get_running_loop()
        if client is None:
            return False
        for address in self._hearing.heard:
            # One question at a time: one that is stopped keeps the last one for as long.
            if address not in self._asking:
                asking = asyncio.ensure_future(client.run(os.getpid, workers=[address]))
                self._asking[address] = asking
                asking.add_done_callback(lambda _, address=address: self._asking.pop(address))
        deadline, waiting = loop.time() + READY_SECONDS, set(self._asking.values())
        while waiting and (left := deadline - loop.time()) > 0:
            done, waiting = await asyncio.wait(
                waiting, timeout=left, return_when=asyncio.FIRST_COMPLETED
            )
            if any(not asked.cancelled() and asked.exception() is None for asked in done):
                return True
        return False

    async def run(self, terms: Terms, payload: bytes) -> bytes:
        """Have a worker do a task when its owner's turn has come; gives what it answered.

        Raises
        ------
        ClusterError
            If the scheduler or all workers are lost meanwhile.
        BaseException
            The error of the task.
        """
        async with self._turns.turn(terms):
            return await self._done(terms, payload)

    async def _done(self, terms: Terms, payload: bytes) -> bytes:
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
                return await self._result(remote)

    async def _result(self, remote: Any) -> bytes:
        try:
            answer = await remote
            # What is not bytes is no answer of ours, and is not read as one.
            return answer if isinstance(answer, bytes) else b""
        except FutureCancelled as error:
            # By us alone: asyncio's own exception of that name is another one.
            if remote not in self._remotes:
                raise _MovedError from error
            raise self._is_lost() from error
        except KilledWorker as error:
            raise WorkerDiedError(
                "Several workers ended while they were at work on this.",
                remedy="The input may break a reader; try to send it in another format.",
            ) from error
        finally:
            self._remotes.discard(remote)
            # A worker that is still at it sees that its result is wanted no more.
            remote.release()

    async def connect(self) -> None:
        """Connect, and see that workers share the folder.

        Raises
        ------
        ClusterError
            If there is no scheduler, no worker, or one that does not share the folder.
        """
        loop, seconds = asyncio.get_running_loop(), self._settings.connect_seconds
        deadline = loop.time() + seconds
        client = Client(
            self._address,
            asynchronous=True,
            set_as_default=False,
            timeout=seconds,
            name="modalmotion",
        )
        try:
            await client
        except (OSError, TimeoutError, ValueError) as error:
            # Left open it would want our loop when it is collected, which may be gone by then.
            await client.close(timeout=1.0)
            raise ClusterError(
                f"There is no scheduler at '{self._address}' (tried for {seconds:g} s): {error}",
                remedy="Start it, or correct the address (MODALMOTION_SCHEDULER).",
            ) from error
        try:
            await self._take_up(client, deadline - loop.time())
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
        self._hearing.note(said["workers"], asyncio.get_running_loop().time())
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

    async def supervise(self) -> None:
        """Look after the scheduler and the workers, for ever."""
        without_worker, look_seconds = 0.0, self._settings.look_seconds
        while True:
            await asyncio.sleep(look_seconds)
            if self._client is None:
                with contextlib.suppress(ClusterError, OSError):
                    await self.connect()
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
            without_worker = 0.0 if self._n_places else without_worker + look_seconds
            if without_worker >= self._settings.patience_seconds and self._remotes:
                logger.error("the scheduler at %s has no worker", self._address)
                self._turns.give_up(self._has_no_worker())
                await self._client.cancel(list(self._remotes), force=True)
                without_worker = 0.0

    async def close(self) -> None:
        """Leave the scheduler."""
        if self._client is not None:
            await self._client.close(timeout=5.0)
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        # Dask's own may go on trying to connect whatever is asked of them.
        if others:
            await asyncio.wait(others, timeout=2.0)

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
