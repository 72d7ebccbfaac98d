"""Jobs: long work and its progress."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Annotated

from fastapi import Query, Response
from starlette.responses import FileResponse

from modalmotion.errors import LostFileError, NotFoundError
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.routes.asked import AskedNow, job_answer
from modalmotion_service.routes.described import answers
from modalmotion_service.schemas.fields import JobId, Paging
from modalmotion_service.schemas.general import JobAnswer, JobPageAnswer, JobState

router = JudgedRouter(prefix="/v1/jobs", tags=["jobs"])


class JobList(Paging):
    """Which jobs to list."""

    state: JobState | None = None


@router.get("", response_model=JobPageAnswer)
def list_jobs(query: Annotated[JobList, Query()], asked: AskedNow) -> JobPageAnswer:
    """List jobs from the newest to the oldest, a page at a time."""
    page = asked.state.jobs.list(state=query.state, limit=query.limit, cursor=query.cursor)
    jobs = [job_answer(job, asked.state.runner.text(job)) for job in page.jobs]
    return JobPageAnswer(jobs=jobs, cursor=page.cursor)


@router.get("/{job_id}", response_model=JobAnswer)
def describe_job(job_id: JobId, asked: AskedNow, response: Response) -> JobAnswer:
    """Give a job's state, its progress, and the link to its result."""
    record = asked.state.jobs.get(job_id)
    if not record.is_finished:
        response.headers["Retry-After"] = "1"
    return job_answer(record, asked.state.runner.text(record))


@router.get("/{job_id}/result", **answers("*/*", waits=False))
def result_of_job(job_id: JobId, asked: AskedNow) -> Response:
    """Give the file of a job's result: the answer that its request would have had."""
    record = asked.state.jobs.get(job_id)
    outcome = (record.state == JobState.SUCCEEDED and record.result) or {}
    if "file" not in outcome:
        raise NotFoundError(
            f"The job is {record.state.value} and has no file.",
            remedy="Follow the result link of its answer, once it has succeeded.",
        )
    path = asked.state.spool.at(outcome["file"])
    if not path.is_file():
        age = datetime.now(UTC) - datetime.fromisoformat(record.updated)
        if age < timedelta(hours=asked.state.settings.result_hours):
            raise LostFileError(
                "The job's file is lost: its time has not passed, and it is missing.",
                remedy="Start the job again.",
            )
        raise NotFoundError("The job's file is no longer kept.", remedy="Start the job again.")
    return FileResponse(path, media_type=outcome["media_type"], headers=outcome.get("headers"))


@router.delete("/{job_id}", response_model=JobAnswer)
async def cancel_job(job_id: JobId, asked: AskedNow) -> JobAnswer:
    """End a job; 409 if it is finished."""
    return job_answer(await asked.state.runner.cancel(job_id))
