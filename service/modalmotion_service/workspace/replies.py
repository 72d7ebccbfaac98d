"""Answers that nobody keeps: made for a request, or left to a job whose result is a file."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from modalmotion_service.workspace.job_runner import Report
from modalmotion_service.workspace.spool import Spool

Request = Mapping[str, Any]
"""What an answer is made of: JSON values, queries and facts, by name. `name` is its own."""

Maker = Callable[[Request, Report], Awaitable["Reply"]]


@dataclass(frozen=True)
class Reply:
    """The body of an answer.

    Parameters
    ----------
    content : bytes or Path
        A file lies in the spool, and whoever has the reply removes it.
    media_type : str
    headers : dict
    """

    content: bytes | Path
    media_type: str
    headers: Mapping[str, str] = field(default_factory=dict)


class Replies:
    """Makes answers by their kind; work that a request leaves to a job goes on for the job.

    Parameters
    ----------
    makers : dict
        By kind.
    spool : Spool
    """

    def __init__(self, makers: Mapping[str, Maker], spool: Spool) -> None:
        self._makers = makers
        self._spool = spool
        self._left: dict[str, asyncio.Task[Reply]] = {}
        self._reports: dict[str, Report] = {}

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of all kinds."""
        return tuple(self._makers)

    async def make(self, kind: str, request: Request) -> Reply:
        """Make an answer."""

        def report(share: float, text: str = "") -> None:
            if (listener := self._reports.get(request.get("name", ""))) is not None:
                listener(share, text)

        return await self._makers[kind](request, report)

    def leave(self, request: Request, work: asyncio.Task[Reply]) -> None:
        """Hold work for the job that is to go on with it."""
        self._left[request["name"]] = work

    def drop(self, request: Request) -> None:
        """Hold it no longer."""
        self._left.pop(request["name"], None)

    async def as_job(self, kind: str, request: Request, report: Report) -> dict[str, Any]:
        """Make an answer as a job's result, or wait for the one that was left to it."""
        # One that an earlier version has left has none.
        name = request.get("name", "")
        self._reports[name] = report
        work = self._left.pop(name, None) or asyncio.ensure_future(self.make(kind, request))
        try:
            reply = await work
        finally:
            work.cancel()
            self._reports.pop(name, None)
        if isinstance(reply.content, Path):
            path = reply.content
        else:
            path = self._spool.new_path()
            await asyncio.to_thread(path.write_bytes, reply.content)
        headers = dict(reply.headers)
        return {"file": path.name, "media_type": reply.media_type, "headers": headers}
