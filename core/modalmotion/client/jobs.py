"""Jobs: long work of the service, and waiting for it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

from modalmotion.client.connection import Answer, Call, Connection
from modalmotion.client.errors import (
    BrokenAnswerError,
    JobCancelledError,
    JobUnfinishedError,
    remote_error,
    understood,
)
from modalmotion.client.query import segment
from modalmotion.client.retries import retry_after
from modalmotion.representation import shown

T = TypeVar("T")

# Between two polls of a job, s: short at first, for most jobs are short.
_FIRST_PAUSE: Final = 0.05
_LONGEST_PAUSE: Final = 2.0


@shown("kind", "state", "progress", "result", "id")
@dataclass(frozen=True)
class JobStatus:
    """State and progress of a job.

    Parameters
    ----------
    id, kind : str
    state : str
        queued, running, succeeded, failed or cancelled.
    progress : float
        Share that is done, 0 to 1.
    result : str or None
        Link to the result, once it exists.
    error : dict or None
        The problem it failed with.
    """

    id: str
    kind: str
    state: str
    progress: float
    result: str | None
    error: dict[str, Any] | None

    @staticmethod
    def of(answer: Any) -> JobStatus:
        """Read a description of a job."""
        with understood("a job"):
            result, error = answer["result"], answer["error"]
            return JobStatus(
                id=segment(str(answer["id"])),
                kind=str(answer["kind"]),
                state=str(answer["state"]),
                progress=float(answer["progress"]),
                result=None if result is None else str(result),
                error=None if error is None else dict(error),
            )

    @property
    def is_finished(self) -> bool:
        """Whether it has ended, in whichever way."""
        return self.state in ("succeeded", "failed", "cancelled")


class Job(Generic[T]):
    """A job, with the reader of its result.

    Parameters
    ----------
    connection : Connection
    status : JobStatus
        At the last poll.
    read : function
        Reads the result from the answer to its link.
    accept : str
        Media type to request the result in.
    """

    def __init__(
        self,
        connection: Connection,
        status: JobStatus,
        read: Callable[[Answer], T],
        accept: str,
    ) -> None:
        self.status = status
        self._connection = connection
        self._read = read
        self._accept = accept

    def __repr__(self) -> str:
        return f"Job({self.id}, {self.status.kind}, {self.status.state})"

    @property
    def id(self) -> str:
        """Id of the job at the service."""
        return self.status.id

    def refresh(self) -> JobStatus:
        """Fetch the current status."""
        self._poll()
        return self.status

    def cancel(self) -> None:
        """Cancel the job.

        Raises
        ------
        RemoteError
            With the code `conflict` if it has finished.
        """
        self.status = JobStatus.of(self._connection.send(Call("DELETE", self._path)).json)

    def wait(
        self, *, timeout: float | None = None, progress: Callable[[float], None] | None = None
    ) -> T:
        """Wait for the result.

        Parameters
        ----------
        timeout : float, s, optional
            For ever by default; the job itself goes on afterwards.
        progress : callable, optional
            Called with the share that is done, 0 to 1, at each poll.

        Raises
        ------
        RemoteError
            The problem that the job failed with.
        JobCancelledError
            If it was cancelled.
        JobUnfinishedError
            If the time has passed.
        """
        end = None if timeout is None else time.monotonic() + timeout
        pause = _FIRST_PAUSE
        while True:
            requested = None if self.status.is_finished else self._poll()
            if progress is not None:
                progress(self.status.progress)
            if self.status.is_finished:
                return self._result()
            pause = min(
                2 * pause,
                _LONGEST_PAUSE if requested is None else max(requested, _FIRST_PAUSE),
            )
            if end is not None and time.monotonic() + pause > end:
                raise JobUnfinishedError(
                    f"The job {self.id} is {self.status.state} after {timeout:g} s, "
                    f"{100 * self.status.progress:.0f} % done.",
                    remedy="Wait longer, now or later: it goes on by itself.",
                    details={"job": self.id},
                )
            self._connection.sleep(pause)

    @property
    def _path(self) -> str:
        return f"/v1/jobs/{self.id}"

    def _poll(self) -> float | None:
        answer = self._connection.send(Call("GET", self._path))
        self.status = JobStatus.of(answer.json)
        return retry_after(answer.headers.get("retry-after"))

    def _result(self) -> T:
        if self.status.state == "cancelled":
            raise JobCancelledError(
                f"The job {self.id} was cancelled before it had a result.",
                remedy="Start it again.",
                details={"job": self.id},
            )
        if self.status.error is not None:
            problem = self.status.error
            status = problem.get("status")
            error = remote_error(problem, status if isinstance(status, int) else 500)
            error.details["job"] = self.id
            raise error
        link = self.status.result
        if link is None or not link.startswith("/"):
            raise BrokenAnswerError(
                f"The job {self.id} has succeeded but names no result.",
                remedy="Check the version of the service.",
            )
        answer = self._connection.send(Call("GET", link, accept=self._accept))
        return awaited(self._connection, answer, self._read, self._accept)


def awaited(
    connection: Connection,
    answer: Answer,
    read: Callable[[Answer], T],
    accept: str,
    progress: Callable[[float], None] | None = None,
) -> T:
    """Read an answer; where it is a job (202), wait for its result and read that."""
    if answer.status != 202:
        return read(answer)
    return Job(connection, JobStatus.of(answer.json), read, accept).wait(progress=progress)
