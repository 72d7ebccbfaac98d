"""Jobs; and for operators: health, limits, metrics and the audit log."""

import asyncio
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from typing import Annotated, Final

from fastapi import Query, Request, Response
from prometheus_client.exposition import generate_latest
from starlette.responses import FileResponse

from modalmotion.errors import LostFileError, NotFoundError
from modalmotion.store.index import from_cursor, to_cursor
from modalmotion_service.http.gate import Access
from modalmotion_service.http.gated_router import GatedRouter
from modalmotion_service.monitoring.metrics import require_ready
from modalmotion_service.routes.asked import AskedNow, answers, job_answer
from modalmotion_service.schemas import from_core, general

of_jobs = GatedRouter(prefix="/v1/jobs", tags=["jobs"])


class JobList(from_core.Paging):
    """Which jobs to list."""

    state: general.JobState | None = None


@of_jobs.get("")
def list_jobs(query: Annotated[JobList, Query()], asked: AskedNow) -> general.JobPageAnswer:
    """List jobs from the newest to the oldest, a page at a time."""
    page, cursor = asked.state.jobs.list(**query.model_dump())
    jobs = [job_answer(job, asked.state.runner.text(job)) for job in page]
    return general.JobPageAnswer(jobs=jobs, cursor=cursor)


@of_jobs.get("/{job_id}")
def describe_job(job_id: from_core.JobId, asked: AskedNow, response: Response) -> general.JobAnswer:
    """Give a job's state, its progress, and the link to its result."""
    record = asked.state.jobs.get(job_id)
    if not record.is_finished:
        response.headers["Retry-After"] = "1"
    return job_answer(record, asked.state.runner.text(record))


@of_jobs.get("/{job_id}/result", **answers("*/*", waits=False))
def result_of_job(job_id: from_core.JobId, asked: AskedNow) -> Response:
    """Give the file of a job's result: the answer that its request would have had."""
    record = asked.state.jobs.get(job_id)
    outcome = (record.state == general.JobState.SUCCEEDED and record.result) or {}
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


@of_jobs.delete("/{job_id}")
async def cancel_job(job_id: from_core.JobId, asked: AskedNow) -> general.JobAnswer:
    """End a job; 409 if it is finished."""
    return job_answer(await asked.state.runner.cancel(job_id))


router = GatedRouter(tags=["operation"])

_TEXT: Final = "text/plain; version=0.0.4; charset=utf-8"


@router.get("/health/live")
def is_live() -> general.Health:
    """Return whether the process runs."""
    return general.Health(version=version("modalmotion"))


@router.get("/health/ready")
def is_ready(request: Request) -> general.Readiness:
    """Return whether results can be made and stored: the store answers, and there are workers."""
    local = request.app.state.owners.local
    require_ready(local)
    return general.Readiness(
        version=version("modalmotion"),
        stateless=local.settings.stateless,
        parsers_confined=local.analysis.engine.are_parsers_confined,
    )


@router.get("/v1/limits")
def list_limits(asked: AskedNow) -> dict[str, float]:
    """Give every limit, by the name that its error gives it."""
    return asked.state.settings.limits


@router.get(
    "/metrics",
    response_class=Response,
    responses={
        200: {
            "description": "Counts and gauges, as Prometheus reads them.",
            "content": {"text/plain": {"schema": {"type": "string"}}},
        }
    },
)
async def metrics(request: Request) -> Response:
    """Give metrics of requests, work, jobs and stores, over all owners together."""
    text = await asyncio.to_thread(generate_latest, request.app.state.metrics.registry)
    return Response(text, headers={"Content-Type": _TEXT})


class AuditList(from_core.Paging):
    """Which entries to list."""

    owner: Annotated[str, Query(max_length=63)] | None = None


@router.get("/v1/audit")
async def list_audit(
    query: Annotated[AuditList, Query()], request: Request
) -> general.AuditPageAnswer:
    """List who did what to which id, from the newest to the oldest, a page at a time."""
    access: Access = request.app.state.access
    number = "" if query.cursor is None else from_cursor(query.cursor)[1]
    before = int(number) if number.isdecimal() and len(number) < 19 else None
    entries = await asyncio.to_thread(
        access.audit.page, limit=query.limit + 1, before=before, owner=query.owner
    )
    page = [general.AuditEntryAnswer.of(entry) for entry in entries[: query.limit]]
    is_last = len(entries) <= query.limit
    return general.AuditPageAnswer(
        entries=page, cursor=None if is_last else to_cursor("entry", str(page[-1].number))
    )
