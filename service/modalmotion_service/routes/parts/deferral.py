"""An answer now, or a job for it."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

from starlette.responses import Response

from modalmotion_service.http.preferences import Preference
from modalmotion_service.schemas import JobAnswer
from modalmotion_service.workspace.jobs import Job
from modalmotion_service.workspace.state import State

T = TypeVar("T")


async def result_or_job(
    state: State,
    preference: Preference,
    kind: str,
    request: Any,
    work: Coroutine[Any, Any, T],
) -> T | Response:
    """Wait for work as long as client and settings allow, then leave it to a job and answer 202.

    Parameters
    ----------
    state : State
    preference : Preference
    kind : str
    request : JSON value
        With which a job of that kind does the same work.
    work : coroutine
    """
    wait = state.settings.wait_seconds
    if preference.wait_seconds is not None:
        wait = min(wait, preference.wait_seconds)
    if preference.is_async:
        work.close()
        return accepted(await state.runner.start(kind, request))
    task = asyncio.ensure_future(work)
    try:
        await asyncio.wait([task], timeout=wait)
    except asyncio.CancelledError:
        task.cancel()
        raise
    if task.done():
        return task.result()
    try:
        return accepted(await state.runner.start(kind, request, instead_of=task))
    except BaseException:
        task.cancel()
        raise


def job_answer(job: Job, text: str | None = None) -> JobAnswer:
    """Write a job out, with what it is doing now in words."""
    here = f"/v1/jobs/{job.id}"
    result = job.result or {}
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
