"""Work on several machines, through a Dask scheduler, behind the same `Executor`."""

from __future__ import annotations

import contextlib
import itertools
import json
import logging
import os
import secrets
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, InvalidStateError
from concurrent.futures import wait as wait_for_all
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

from modalmotion_service.errors import ClusterError, NoWorkerError
from modalmotion_service.work.answers import AnswerError, from_bytes, result_type
from modalmotion_service.work.dask.frames import PIECE, Frame, Frames, Kind
from modalmotion_service.work.dask.hearing import SILENT_SECONDS
from modalmotion_service.work.dask.settings import ClusterSettings
from modalmotion_service.work.executor import READY_SECONDS, Engine
from modalmotion_service.work.payload import payload_of
from modalmotion_service.work.pool import unreadable_answer
from modalmotion_service.work.terms import Terms, with_terms

P = ParamSpec("P")
T = TypeVar("T")

logger = logging.getLogger(__name__)

MARK: Final = "cluster"
NOBODY: Final = {"short": 0, "long": 0}
# The bridge speaks every second; importing Dask on a busy machine takes a while.
_SILENT_SECONDS: Final = 60.0
_LOOK_SECONDS: Final = 1.0
# For a word to go through the bridge.
_SAY_SECONDS: Final = 1.0
_END_SECONDS: Final = 10.0


class DaskExecutor(Engine):
    """Tasks on the workers of a Dask scheduler, as `WorkerPool` does them here.

    In each Dask worker a `WorkerPool` does the work: limits, errors and retries are its own.
    A scheduler that is lost fails what is under way with ClusterError, and is looked for until
    it returns; so is work for which there has been no worker for a while. Dask's client runs in
    a process of its own, the bridge, so that no scheduler and no worker can run code in this
    one; a bridge that ends or falls silent is replaced, and what it had under way fails with
    ClusterError.

    Attributes
    ----------
    bridge : subprocess.Popen or None
        The process in which Dask's client runs.

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
    silent_seconds : float
        After this a worker that says nothing counts as gone, and its work is given to another.
    look_seconds : float
        Between two looks at the scheduler and its workers, and before a bridge is begun again.

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
        silent_seconds: float = SILENT_SECONDS,
        look_seconds: float = _LOOK_SECONDS,
    ) -> None:
        self._mark = folder.absolute() / f"{MARK}.{secrets.token_hex(8)}"
        self._settings = ClusterSettings(
            scheduler=scheduler,
            mark=str(self._mark),
            version=version("modalmotion"),
            task_seconds=task_seconds,
            memory_bytes=memory_bytes,
            attempts=attempts,
            connect_seconds=connect_seconds,
            patience_seconds=patience_seconds,
            silent_seconds=silent_seconds,
            look_seconds=look_seconds,
        )
        self._lock = threading.Lock()
        self._numbers = itertools.count(1)
        self._tasks: dict[int, tuple[Future[Any], object]] = {}
        self._out: list[Frame] = []
        self._n_places: int | None = None
        self._n_waiting = NOBODY
        self._refusals: list[BaseException] = []
        self._is_open = True
        self._ending = threading.Event()
        self._looked = threading.Event()
        self.bridge: subprocess.Popen[bytes] | None = None
        self._waker, self._wake = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._remove_marks()
        self._mark.touch()
        self._thread = threading.Thread(target=self._keep, name="dask-executor", daemon=True)
        self._thread.start()
        self._looked.wait()
        if self._n_places is None:
            self.shutdown()
            raise [*self._refusals, self._is_lost()][0]

    @property
    def n_workers(self) -> int:
        """Long tasks that all workers do at once, as they were last looked at."""
        return max(1, self._n_places or 0)

    @property
    def n_waiting(self) -> Mapping[str, int]:
        """Tasks that have not been sent to a worker yet, by lane."""
        return self._n_waiting

    @property
    def are_parsers_confined(self) -> None:
        """Workers on other machines say it in their own logs."""
        return

    def require_ready(self) -> None:
        """Raise ClusterError while there is no scheduler, or no worker that answers."""
        if self._n_places is None:
            raise self._is_lost()
        if not self._n_places:
            raise ClusterError(
                f"The scheduler at '{self._settings.scheduler}' has no workers.",
                remedy="Start some: modalmotion worker ADDRESS.",
            )
        answers: Future[bool] = Future()
        with self._lock:
            number = self._send(Kind.QUESTION, b"", answers, bool)
        try:
            is_ready = answers.result(READY_SECONDS + _SAY_SECONDS)
        except TimeoutError:
            is_ready = False
        finally:
            with self._lock:
                self._tasks.pop(number, None)
        if not is_ready:
            raise NoWorkerError(
                f"None of the scheduler's workers answered within {READY_SECONDS:g} s.",
                remedy="Try again soon; an operator should look after the workers' machines.",
                details={"seconds": READY_SECONDS},
            )

    def submit_for(
        self, terms: Terms, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs
    ) -> Future[T]:
        """Run a task on some worker; cancelling the future ends its process there."""
        payload = with_terms(terms, payload_of(fn, args, kwargs))
        future: Future[T] = Future()
        with self._lock:
            if not self._is_open:
                raise RuntimeError("The executor takes no more tasks.")
            if self._n_places is None:
                future.set_exception(self._is_lost())
                return future
            number = self._send(Kind.TASK, payload, future, result_type(fn))
        future.add_done_callback(lambda done: self._forget(number, done))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more tasks; finish those under way, or end them if asked to."""
        with self._lock:
            was_open, self._is_open = self._is_open, False
            futures = [future for future, _ in self._tasks.values()]
        if not was_open:
            return
        if cancel_futures or not wait:
            for future in futures:
                future.cancel()
        else:
            wait_for_all(futures)
        self._ending.set()
        self._look_up()
        self._thread.join()
        self._remove_marks()
        os.close(self._waker)
        os.close(self._wake)

    def _send(self, kind: Kind, body: bytes, future: Future[Any], expected: object) -> int:
        number = next(self._numbers)
        self._tasks[number] = (future, expected)
        self._out.append(Frame(kind, number, body))
        self._look_up()
        return number

    def _forget(self, number: int, future: Future[Any]) -> None:
        with self._lock:
            if self._tasks.pop(number, None) is None or not future.cancelled():
                return
            self._out.append(Frame(Kind.CANCEL, number))
            # Under the lock, for the pipe closes when nothing is left under way.
            self._look_up()

    def _look_up(self) -> None:
        with contextlib.suppress(OSError):
            os.write(self._wake, b".")

    def _keep(self) -> None:
        """Have a bridge, until the end."""
        while not self._ending.is_set():
            with contextlib.suppress(OSError, ValueError), _started(self._settings) as bridge:
                self.bridge, ours = bridge
                self._serve(ours)
            with self._lock:
                self._n_places = None
                lost, self._tasks, self._out = self._tasks, {}, []
            for future, _ in lost.values():
                with contextlib.suppress(InvalidStateError):
                    future.set_exception(self._is_lost())
            if self._ending.is_set() or not self._looked.is_set():
                break
            logger.error("the bridge to the scheduler ended, and is begun again")
            time.sleep(self._settings.look_seconds)
        self._looked.set()

    def _serve(self, ours: socket.socket) -> None:
        """Speak with one bridge, until it ends or falls silent."""
        # No answer is larger than the memory of whoever made it.
        frames, out = Frames(self._settings.memory_bytes), b""
        heard = time.monotonic()
        # The first word comes when it has reached the scheduler, or has not.
        patience = _SILENT_SECONDS + self._settings.connect_seconds
        while not self._ending.is_set() and time.monotonic() < heard + patience:
            with self._lock:
                waiting, self._out = self._out, []
            out += b"".join(frame.to_bytes() for frame in waiting)
            poll = select.poll()
            poll.register(ours, select.POLLIN | (select.POLLOUT if out else 0))
            poll.register(self._waker, select.POLLIN)
            ready = dict(poll.poll(1000.0))
            if self._waker in ready:
                with contextlib.suppress(BlockingIOError):
                    os.read(self._waker, 4096)
            event = ready.get(ours.fileno(), 0)
            if event & select.POLLOUT:
                out = out[ours.send(out) :]
            if event & ~select.POLLOUT:
                piece = ours.recv(PIECE)
                if not piece:
                    return
                for frame in frames.add(piece):
                    if frame.kind is Kind.STATE:
                        patience = _SILENT_SECONDS
                    self._take(frame)
                heard = time.monotonic()

    def _take(self, frame: Frame) -> None:
        if frame.kind is Kind.STATE:
            self._n_places, self._n_waiting = None, NOBODY
            if frame.body:
                self._n_places, short, long = map(int, frame.body.split())
                self._n_waiting = {"short": short, "long": long}
            self._looked.set()
        elif frame.kind is Kind.REFUSAL:
            self._refusals = [_error_in(frame.body)]
        elif frame.kind in (Kind.ANSWER, Kind.READY):
            with self._lock:
                future, expected = self._tasks.get(frame.number, (None, None))
            if future is not None:
                _settle(future, frame, expected)

    def _remove_marks(self) -> None:
        for path in self._mark.parent.glob(f"{MARK}.*"):
            path.unlink(missing_ok=True)

    def _is_lost(self) -> ClusterError:
        return ClusterError(
            f"The scheduler at '{self._settings.scheduler}' cannot be reached, or gave the work "
            "up.",
            remedy="Try again soon; an operator should look after the scheduler and its workers.",
        )


@contextlib.contextmanager
def _started(settings: ClusterSettings) -> Iterator[tuple[subprocess.Popen[bytes], socket.socket]]:
    """Start a bridge; gives it and the socket that leads to it, and ends it."""
    ours, theirs = socket.socketpair()
    level = logging.getLevelName(logger.getEffectiveLevel())
    with ours, theirs:
        process = subprocess.Popen(  # noqa: S603 (ourselves)
            [
                *(sys.executable, "-m", "modalmotion_service.work.dask.bridge"),
                *(str(theirs.fileno()), level, json.dumps(asdict(settings))),
            ],
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            # What the service is told is not for whoever may own the bridge.
            env={name: value for name, value in os.environ.items() if "MODALMOTION" not in name},
        )
        theirs.close()
        ours.setblocking(False)
        try:
            yield process, ours
        finally:
            with contextlib.suppress(OSError):
                ours.shutdown(socket.SHUT_RDWR)
            try:
                process.wait(_END_SECONDS)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _settle(future: Future[Any], frame: Frame, expected: object) -> None:
    with contextlib.suppress(InvalidStateError):
        try:
            if frame.kind is Kind.READY:
                result = bool(frame.body)
            else:
                result = from_bytes(frame.body, expected)
        except AnswerError:
            future.set_exception(unreadable_answer())
        except BaseException as error:  # noqa: BLE001 (it is the task's)
            future.set_exception(error)
        else:
            future.set_result(result)


def _error_in(answer: bytes) -> BaseException:
    try:
        from_bytes(answer, None)
    except BaseException as error:  # noqa: BLE001 (it is what was sent)
        return error
    return unreadable_answer()
