"""An answer now, or a job for it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from pathlib import Path
from typing import Any, TypeVar

from starlette.responses import Response

from modalmotion_service.errors import BusyError
from modalmotion_service.http.preferences import Preference
from modalmotion_service.routes.parts.temporary_file import temporary_file
from modalmotion_service.schemas import JobAnswer, JobState
from modalmotion_service.workspace.jobs import Job
from modalmotion_service.workspace.reply_kinds import as_json
from modalmotion_service.workspace.spool import SpoolFile
from modalmotion_service.workspace.state import State

T = TypeVar("T")


async def result_or_job(
    state: State,
    preference: Preference,
    kind: str,
    request: Any,
    work: Coroutine[Any, Any, T],
    leave: Callable[[asyncio.Task[T] | None], Awaitable[Any]] | None = None,
) -> T | Response:
    """Wait for work as long as client and settings allow, then leave it to a job and answer 202.

    Where nothing is kept there are no jobs, and it is waited for to its end.

    Parameters
    ----------
    state : State
    preference : Preference
    kind : str
    request : JSON value or callable
        With which a job of that kind does the same work.
    work : coroutine
    leave : async function, optional
        Called before a job is acknowledged, with the work if it has begun.
    """
    if state.settings.stateless:
        # Another replica would not know the job; the work has limits of its own.
        return await work
    wait = state.settings.wait_seconds
    if preference.wait_seconds is not None:
        wait = min(wait, preference.wait_seconds)
    task: asyncio.Task[T] | None = None
    if preference.is_async:
        work.close()
    else:
        task = asyncio.ensure_future(work)
        try:
            await asyncio.wait([task], timeout=wait)
        except asyncio.CancelledError:
            task.cancel()
            raise
        if task.done():
            return task.result()

    try:
        if leave is not None:
            await leave(task)
        body = request() if callable(request) else request
        return accepted(await state.runner.start(kind, body, instead_of=task))
    except BaseException:
        if task is not None:
            task.cancel()
        raise


async def reply_or_job(
    state: State,
    preference: Preference,
    kind: str,
    request: Mapping[str, Any],
    file: SpoolFile | None = None,
    headers: Mapping[str, str] | None = None,
) -> Response:
    """Give an answer that nobody keeps, or a job whose result is a file with it.

    Parameters
    ----------
    state : State
    preference : Preference
    kind : str
        Of the answer, and of the job.
    request : mapping
        What it is made of; queries and facts may stand in it as they are.
    file : SpoolFile, optional
        The upload, which is the job's from then on where there is one.
    headers : mapping, optional
        Of an answer that is not left to a job.
    """
    name = state.spool.new_path().name
    whole = {**request, "name": name}
    if file is not None:
        whole |= {"file": file.path.name, "facts": file.facts}

    async def leave(work: asyncio.Task[Any] | None) -> None:
        if file is not None:
            await asyncio.to_thread(file.make_durable)
        if work is not None:
            state.replies.leave(whole, work)

    try:
        work = state.replies.make(kind, whole)
        result = await result_or_job(state, preference, kind, lambda: as_json(whole), work, leave)
    except BaseException:
        state.replies.drop(whole)
        raise
    if isinstance(result, Response):
        if file is not None:
            file.is_left = True
        return result
    sent = {**result.headers, **(headers or {})}
    if isinstance(result.content, Path):
        return temporary_file(result.content, result.media_type, headers=sent)
    return Response(result.content, 200, sent, result.media_type)


async def in_time(state: State, work: Coroutine[Any, Any, T]) -> T:
    """Wait for work that no job can do as long as the settings allow.

    Raises
    ------
    BusyError
        If it takes longer; then it is given up.
    """
    wait = state.settings.wait_seconds
    try:
        async with asyncio.timeout(wait):
            return await work
    except TimeoutError:
        raise BusyError(
            f"The workers did not come to this within {wait:g} s.",
            remedy="Wait a little and send it again.",
            limit="wait_seconds",
            details={"most": wait},
        ) from None


def job_answer(job: Job, text: str | None = None) -> JobAnswer:
    """Write a job out, with what it is doing now in words."""
    here = f"/v1/jobs/{job.id}"
    # Noted a little before the job has succeeded.
    result = (job.state == JobState.SUCCEEDED and job.result) or {}
    return JobAnswer(
        id=job.id,
        kind=job.kind,
        state=job.state,
        progress=job.progress,
        text=text or None,
        result=f"{here}/result" if "file" in result else result.get("link"),
        error=job.error,
        created=job.created,
        updated=job.updated,
        links={"self": here},
    )


def accepted(job: Job) -> Response:
    """Answer 202 with a job."""
    return Response(
        job_answer(job).model_dump_json(),
        status_code=202,
        media_type="application/json",
        headers={
            "Location": f"/v1/jobs/{job.id}",
            "Retry-After": "1",
            "Preference-Applied": "respond-async",
        },
    )
