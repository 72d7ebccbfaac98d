"""The process between the service and a scheduler, the only one that Dask speaks to.

Dask's client unpickles what a scheduler or a worker sends, so whoever owns one of them owns the
process of the client too. That is this one: it opens no result, no key and no connection of a
user, and what it tells the service is read as a stranger's (see `answers`).
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import logging.config
import secrets
import socket
import sys
import time
from concurrent.futures import CancelledError as FutureCancelled
from pathlib import Path
from typing import Any, Final

from distributed import Client, KilledWorker

from modalmotion_service.errors import ClusterError, WorkerDiedError
from modalmotion_service.http.observation import log_config
from modalmotion_service.work.answers import error_to_bytes
from modalmotion_service.work.dask.bridge_settings import BridgeSettings
from modalmotion_service.work.dask.frames import Frame, Frames, Kind
from modalmotion_service.work.dask.logs import log_dask_as_json
from modalmotion_service.work.dask.tasks import PLUGIN, Mark, PoolLimits, PoolPlugin, run_in_pool

logger = logging.getLogger(__name__)

_LOOK_SECONDS: Final = 1.0
# A machine under load may be slow to answer; a connection that breaks is seen at once.
_ANSWER_SECONDS: Final = 30.0
# Workers report to the scheduler twice a second; one in silence for so long is stopped or gone.
_SILENT_SECONDS: Final = 15.0
# How often work moves away from workers that fell silent.
_MOST_MOVES: Final = 3
_PIECE: Final = 1 << 20


class Bridge:
    """A client of the scheduler that does what frames tell it.

    Parameters
    ----------
    settings : BridgeSettings
    ours : socket.socket
        It leads to the service; its end is the end of the bridge.
    """

    def __init__(self, settings: BridgeSettings, ours: socket.socket) -> None:
        self._settings = settings
        self._socket = ours
        self._limits = PoolLimits(settings.task_seconds, settings.memory_bytes, settings.attempts)
        self._mark = Mark(Path(settings.mark), settings.version)
        self._client: Client | None = None
        self._tasks: dict[int, asyncio.Task[None]] = {}
        self._remotes: dict[str, asyncio.Future[None]] = {}
        self._workers = _Workers()
        self._writer: asyncio.StreamWriter | None = None

    async def run(self) -> None:
        """Work until the service is gone."""
        reader, self._writer = await asyncio.open_unix_connection(sock=self._socket)
        try:
            await self._connect()
        except ClusterError as error:
            self._say(Frame(Kind.REFUSAL, 0, error_to_bytes(error)))
            await self._writer.drain()
            return
        supervision = asyncio.create_task(self._supervise())
        try:
            with contextlib.suppress(OSError):
                await self._listen(reader)
        finally:
            supervision.cancel()
            for task in [*self._tasks.values()]:
                task.cancel()
            await asyncio.wait([supervision, *self._tasks.values()], timeout=2.0)
            if self._client is not None:
                await self._client.close(timeout=5.0)

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        frames = Frames()
        while piece := await reader.read(_PIECE):
            for frame in frames.add(piece):
                if frame.kind is Kind.CANCEL:
                    if (task := self._tasks.get(frame.number)) is not None:
                        task.cancel()
                else:
                    work = asyncio.create_task(self._do(frame.number, frame.body))
                    self._tasks[frame.number] = work

    async def _do(self, number: int, payload: bytes) -> None:
        try:
            answer = await self._result(payload)
        except Exception as error:  # noqa: BLE001 (all of them are the sender's)
            answer = error_to_bytes(error)
        finally:
            del self._tasks[number]
        self._say(Frame(Kind.ANSWER, number, answer))

    async def _result(self, payload: bytes) -> bytes:
        for _ in range(_MOST_MOVES):
            done, answer = await self._sent(payload)
            if done:
                return answer
        raise WorkerDiedError(
            f"{_MOST_MOVES} workers fell silent while they were at work on this.",
            remedy="Try again; an operator should look after the workers.",
        )

    async def _sent(self, payload: bytes) -> tuple[bool, bytes]:
        """Have one worker do it; False if that worker fell silent."""
        client = self._client
        if client is None:
            raise self._is_lost()
        key = f"modalmotion-{secrets.token_hex(16)}"
        heard = self._workers.heard
        remote = client.submit(
            run_in_pool,
            payload,
            self._limits,
            self._mark,
            key=key,
            pure=False,
            **({"workers": heard, "allow_other_workers": True} if heard else {}),
        )
        silence = self._remotes[key] = asyncio.get_running_loop().create_future()
        result = asyncio.ensure_future(remote.result())
        try:
            await asyncio.wait([result, silence], return_when=asyncio.FIRST_COMPLETED)
            if not result.done():
                return False, b""
            answer = result.result()
        except FutureCancelled as error:
            # Not by us: asyncio's own exception of that name is another one.
            raise self._is_lost() from error
        except KilledWorker as error:
            raise WorkerDiedError(
                "Several workers ended while they were at work on this.",
                remedy="The input may break a reader; try to send it in another format.",
            ) from error
        finally:
            result.cancel()
            del self._remotes[key]
            # A worker that is still at it sees that its result is wanted no more.
            remote.release()
        return True, answer if isinstance(answer, bytes) else b""

    def _say(self, frame: Frame) -> None:
        if self._writer is not None and not self._writer.is_closing():
            self._writer.write(frame.to_bytes())

    async def _connect(self) -> None:
        loop = asyncio.get_running_loop()
        address, seconds = self._settings.scheduler, self._settings.connect_seconds
        deadline = loop.time() + seconds
        client = Client(
            address, asynchronous=True, set_as_default=False, timeout=seconds, name="modalmotion"
        )
        try:
            await client
        except (OSError, TimeoutError, ValueError) as error:
            # Left open it would want our loop when it is collected, which may be gone by then.
            await client.close(timeout=1.0)
            raise ClusterError(
                f"There is no scheduler at '{address}' (tried for {seconds:g} s): {error}",
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
        try:
            answers = await asyncio.wait_for(
                client.run(self._mark.write_beside, on_error="return"), _ANSWER_SECONDS
            )
        except TimeoutError as error:
            raise ClusterError(
                f"Workers of the scheduler at '{self._settings.scheduler}' do not answer.",
                remedy="Look after the workers: one may be stopped, or its machine gone.",
            ) from error
        for worker, answer in answers.items():
            if isinstance(answer, ClusterError):
                raise answer
            if isinstance(answer, BaseException):
                raise ClusterError(
                    f"The worker at {worker} cannot do our work: {type(answer).__name__}: {answer}",
                    remedy="Run workers with `modalmotion worker`, of this version.",
                ) from answer
        folder = self._mark.path.parent
        names = {str(name) for name in answers.values()}
        if missing := names - {path.name for path in folder.iterdir()}:
            raise ClusterError(
                f"What {len(missing)} of {len(answers)} workers write to '{folder}' does not "
                "arrive here.",
                remedy="Mount the same volume under the same path everywhere.",
            )
        await client.register_plugin(PoolPlugin(self._limits), name=PLUGIN)
        self._workers.look(await _all_workers(client))
        self._say_state(self._workers.n_threads)

    async def _supervise(self) -> None:
        without_worker = 0.0
        while True:
            await asyncio.sleep(_LOOK_SECONDS)
            if self._client is None:
                self._say_state(None)
                with contextlib.suppress(ClusterError, OSError):
                    await self._connect()
                    logger.warning("the scheduler at %s is back", self._settings.scheduler)
                continue
            try:
                self._workers.look(await _all_workers(self._client))
            except (OSError, TimeoutError, FutureCancelled) as error:
                logger.error(  # noqa: TRY400 (met when a machine restarts: no traceback)
                    "the scheduler at %s is lost: %r", self._settings.scheduler, error
                )
                lost, self._client = self._client, None
                self._say_state(None)
                await lost.close(timeout=1.0)
                continue
            n_threads = self._workers.n_threads
            self._say_state(n_threads)
            without_worker = 0.0 if n_threads else without_worker + _LOOK_SECONDS
            if n_threads and self._workers.silent:
                await self._move(self._client)
            if without_worker >= self._settings.patience_seconds and self._remotes:
                logger.error("the scheduler at %s has no worker", self._settings.scheduler)
                for task in self._give_up():
                    task.cancel()
                without_worker = 0.0

    def _give_up(self) -> list[asyncio.Task[None]]:
        tasks = [*self._tasks.items()]
        answer = error_to_bytes(self._has_no_worker())
        for number, _ in tasks:
            self._say(Frame(Kind.ANSWER, number, answer))
        return [task for _, task in tasks]

    async def _move(self, client: Client) -> None:
        """Have others do what lies with workers that fell silent."""
        with contextlib.suppress(OSError, TimeoutError):
            processing = await asyncio.wait_for(client.processing(), _ANSWER_SECONDS)
            for worker in self._workers.silent & processing.keys():
                moved = [key for key in processing[worker] if key in self._remotes]
                if moved:
                    logger.error("the worker at %s is silent; its work moves", worker)
                for key in moved:
                    with contextlib.suppress(asyncio.InvalidStateError):
                        self._remotes[key].set_result(None)

    def _say_state(self, n_threads: int | None) -> None:
        self._say(Frame(Kind.STATE, 0, b"" if n_threads is None else str(n_threads).encode()))

    def _is_lost(self) -> ClusterError:
        return ClusterError(
            f"The scheduler at '{self._settings.scheduler}' cannot be reached, or gave the work "
            "up.",
            remedy="Try again soon; an operator should look after the scheduler and its workers.",
        )

    def _has_no_worker(self) -> ClusterError:
        return ClusterError(
            f"The scheduler at '{self._settings.scheduler}' has no workers that answer.",
            remedy="Start some: modalmotion worker ADDRESS.",
        )


class _Workers:
    """When each worker was last heard of: the scheduler's word changes with each report."""

    def __init__(self) -> None:
        self._heard: dict[str, tuple[float, float]] = {}
        self._threads: dict[str, int] = {}

    def look(self, workers: dict[str, dict[str, Any]]) -> None:
        now = time.monotonic()
        self._threads = {address: int(state["nthreads"]) for address, state in workers.items()}
        heard = {}
        for address, state in workers.items():
            said, when = self._heard.get(address, (None, now))
            last = float(state["last_seen"])
            heard[address] = (last, when if said == last else now)
        self._heard = heard

    @property
    def silent(self) -> set[str]:
        then = time.monotonic() - _SILENT_SECONDS
        return {address for address, (_, when) in self._heard.items() if when < then}

    @property
    def heard(self) -> list[str]:
        """Those that answer, where others do not; else empty."""
        silent = self.silent
        return [address for address in self._heard if address not in silent] if silent else []

    @property
    def n_threads(self) -> int:
        silent = self.silent
        return sum(n for address, n in self._threads.items() if address not in silent)


async def _all_workers(client: Client) -> dict[str, dict[str, Any]]:
    """State of each worker, by its address; OSError if the scheduler is lost."""
    if client.status != "running":
        raise OSError(f"the connection is {client.status}")
    identity = await asyncio.wait_for(client.scheduler.identity(n_workers=-1), _ANSWER_SECONDS)
    workers: dict[str, dict[str, Any]] = identity["workers"]
    return workers


def main() -> None:
    """Run with a socket's number and the settings as arguments."""
    ours = socket.socket(fileno=int(sys.argv[1]))
    settings = BridgeSettings(**json.loads(sys.argv[2]))
    logging.config.dictConfig(log_config(settings.log_level))
    log_dask_as_json()
    asyncio.run(Bridge(settings, ours).run())


if __name__ == "__main__":
    main()
