"""The record of who did what, for administrators: of all owners."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import Query, Request
from pydantic import BaseModel, ConfigDict, Field

from modalmotion_service.audit.log import AuditLog
from modalmotion_service.http.gate import Access
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.routes.parts.openapi_parts import PROBLEMS
from modalmotion_service.schemas.access import AuditEntryAnswer, AuditPageAnswer

router = JudgedRouter(prefix="/v1/audit", tags=["audit"], responses=PROBLEMS)


class AuditQuery(BaseModel):
    """Which entries to list."""

    model_config = ConfigDict(extra="forbid")

    owner: str | None = Field(None, max_length=63, description="Only what this owner did.")
    limit: int = Field(100, ge=1, le=1000, description="Of one page.")
    cursor: int | None = Field(None, ge=1, lt=1 << 62, description="Of the page before.")


@router.get("")
async def list_entries(query: Annotated[AuditQuery, Query()], request: Request) -> AuditPageAnswer:
    """List who did what to which id, from the newest to the oldest, a page at a time."""
    access: Access = request.app.state.access
    log = access.audit
    assert isinstance(log, AuditLog)  # noqa: S101 (a service that keeps nothing has no such call)
    entries = await asyncio.to_thread(
        log.page, limit=query.limit + 1, before=query.cursor, owner=query.owner
    )
    page = [AuditEntryAnswer.of(entry) for entry in entries[: query.limit]]
    return AuditPageAnswer(
        entries=page, cursor=page[-1].number if len(entries) > query.limit else None
    )
