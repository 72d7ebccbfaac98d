"""For operators: whether the service is alive and ready, its limits, metrics and audit log."""

from __future__ import annotations

import asyncio
from importlib.metadata import version
from typing import Annotated, Final

from fastapi import Query, Request, Response
from prometheus_client.exposition import generate_latest

from modalmotion.store.index.cursor import from_cursor, to_cursor
from modalmotion_service.audit.log import AuditLog
from modalmotion_service.http.gate import Access
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.monitoring.metrics import require_ready
from modalmotion_service.routes.asked import AskedNow
from modalmotion_service.schemas.fields import Paging
from modalmotion_service.schemas.general import AuditEntryAnswer, AuditPageAnswer, Health, Readiness

router = JudgedRouter(tags=["operation"])

_TEXT: Final = "text/plain; version=0.0.4; charset=utf-8"


@router.get("/health/live", response_model=Health)
def is_live() -> Health:
    """Tell whether the process runs."""
    return Health(version=version("modalmotion"))


@router.get("/health/ready", response_model=Readiness)
def is_ready(request: Request) -> Readiness:
    """Tell whether results can be made and stored: the store answers, and there are workers."""
    local = request.app.state.owners.local
    require_ready(local)
    return Readiness(
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


class AuditList(Paging):
    """Which entries to list."""

    owner: Annotated[str, Query(max_length=63)] | None = None


@router.get("/v1/audit", response_model=AuditPageAnswer)
async def list_audit(query: Annotated[AuditList, Query()], request: Request) -> AuditPageAnswer:
    """List who did what to which id, from the newest to the oldest, a page at a time."""
    access: Access = request.app.state.access
    log = access.audit
    assert isinstance(log, AuditLog)  # noqa: S101 (a service that keeps nothing has no such call)
    number = "" if query.cursor is None else from_cursor(query.cursor)[1]
    before = int(number) if number.isdecimal() and len(number) < 19 else None
    entries = await asyncio.to_thread(
        log.page, limit=query.limit + 1, before=before, owner=query.owner
    )
    page = [AuditEntryAnswer.of(entry) for entry in entries[: query.limit]]
    is_last = len(entries) <= query.limit
    return AuditPageAnswer(
        entries=page, cursor=None if is_last else to_cursor("entry", str(page[-1].number))
    )
