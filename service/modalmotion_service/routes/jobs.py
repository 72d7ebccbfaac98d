"""Jobs: long work and its progress."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Annotated

from fastapi import Query, Response
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import FileResponse

from modalmotion.errors import LostFileError, NotFoundError
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import HDF5, NPZ
from modalmotion_service.routes.parts.deferral import job_answer
from modalmotion_service.routes.parts.dependencies import StateDependency
from modalmotion_service.routes.parts.openapi_parts import BINARY, PROBLEMS
from modalmotion_service.schemas import JobAnswer, JobId, JobPageAnswer, JobState

router = JudgedRouter(prefix="/v1/jobs", tags=["jobs"], responses=PROBLEMS)


class ListQuery(BaseModel):
    """Which jobs to list."""

    model_config = ConfigDict(extra="forbid")

    state: JobState | None = None
    limit: int = Field(100, ge=1, le=1000, description="Of one page.")
    cursor: str | None = Field(None, max_length=200, description="Of the page before.")


@router.get("")
def list_jobs(query: Annotated[ListQuery, Query()], state: StateDependency) -> JobPageAnswer:
    """List jobs from the newest to the oldest, a page at a time."""
    page = state.jobs.list(state=query.state, limit=query.limit, cursor=query.cursor)
    jobs = [job_answer(job, state.runner.text(job)) for job in page.jobs]
    return JobPageAnswer(jobs=jobs, cursor=page.cursor)


@router.get("/{job_id}")
def job(job_id: JobId, state: StateDependency, response: Response) -> JobAnswer:
    """Give a job's state, its progress, and the link to its result."""
    record = state.jobs.get(job_id)
    if not record.is_finished:
        response.headers["Retry-After"] = "1"
    return job_answer(record, state.runner.text(record))


@router.get(
    "/{job_id}/result",
    response_class=Response,
    responses={200: {"description": "The file.", "content": {NPZ: BINARY, HDF5: BINARY}}},
)
def result(job_id: JobId, state: StateDependency) -> Response:
    """Give the file of a job's result."""
    record = state.jobs.get(job_id)
    outcome = (record.state == JobState.SUCCEEDED and record.result) or {}
    if "file" not in outcome:
        raise NotFoundError(
            f"The job is {record.state.value} and has no file.",
            remedy="Follow the result link of its answer, once it has succeeded.",
        )
    path = state.spool.at(outcome["file"])
    if not path.is_file():
        age = datetime.now(UTC) - datetime.fromisoformat(record.updated)
        if age < timedelta(hours=state.settings.result_hours):
            raise LostFileError(
                "The job's file is lost: its time has not passed, and it is missing.",
                remedy="Start the job again.",
            )
        raise NotFoundError("The job's file is no longer kept.", remedy="Start the job again.")
    return FileResponse(path, media_type=outcome["media_type"], headers=outcome.get("headers"))


@router.delete("/{job_id}")
async def cancel(job_id: JobId, state: StateDependency) -> JobAnswer:
    """End a job; 409 if it is finished."""
    return job_answer(await state.runner.cancel(job_id))
