"""Mesh sequences: upload, list, summary, names, deletion."""

from __future__ import annotations

import asyncio
import json
from typing import Annotated, TypeVar

from fastapi import Query, Request, Response
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from modalmotion.facts import NO_FACTS, Facts, facts_as_json, facts_patched
from modalmotion_service.http.conditional import is_known, not_modified, tag_of
from modalmotion_service.http.gate import note_facts, note_ids
from modalmotion_service.http.json_bodies import JsonRoute
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.routes.parts.deferral import result_or_job
from modalmotion_service.routes.parts.dependencies import (
    NamedFileDependency,
    PreferenceDependency,
    StateDependency,
    StoreDependency,
)
from modalmotion_service.routes.parts.idempotency import IdempotencyKey, idempotent_answer
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, NAMED_UPLOAD_BODY, PROBLEMS
from modalmotion_service.schemas import (
    SequenceId,
    SequenceNames,
    SequencePageAnswer,
    SequenceSummary,
    UploadQuery,
)
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.erasure import erase
from modalmotion_service.workspace.restating import restate

NamedQuery = TypeVar("NamedQuery", bound=BaseModel)

router = JudgedRouter(
    prefix="/v1/sequences", tags=["sequences"], responses=PROBLEMS, route_class=JsonRoute
)


@router.post(
    "",
    status_code=201,
    response_model=SequenceSummary,
    openapi_extra=NAMED_UPLOAD_BODY,
    responses={200: {"model": SequenceSummary, "description": "Known already."}, **ACCEPTED},
)
async def upload(
    file: NamedFileDependency,
    query: Annotated[UploadQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Keep a mesh sequence: npz, VTKHDF, a zip of frames, GLB, or raw numbers.

    The same content has the same id: 201 when it is new, 200 when it was known, and 202 with a
    job where the client would rather not wait or the work takes long. Subject, label and facts that
    are stated with a known one are filled in where they are unknown; where they differ from what is
    known, the answer is 409, and PATCH changes them.
    """
    # A name in the query overrides that in the form.
    query = named(query, file.names)
    form_facts = facts_as_json(file.facts)

    async def make() -> Response:
        sent = Upload(file.path, query.options(state.settings.read_limits, file.facts))
        job = {
            "file": file.path.name,
            "query": query.model_dump(mode="json"),
            "facts": form_facts,
        }
        if preference.is_async or state.settings.wait_seconds < state.settings.task_seconds:
            # A job may be acknowledged before the bytes are read: they must outlive a crash.
            await asyncio.to_thread(file.make_durable)
        work = state.analysis.keep(sent, subject=query.subject, label=query.label)
        result = await result_or_job(state, preference, "upload", job, work)
        if isinstance(result, Response):
            file.is_left = True
            return result
        note_facts(request, result.filled)
        status = 201 if result.is_new else 200
        return _answer(SequenceSummary.of(result.record, result.reading), status)

    with file:
        fingerprint = (
            "POST /v1/sequences",
            file.sha256,
            query.model_dump_json(),
            json.dumps(form_facts),
        )
        return await idempotent_answer(state.idempotency, idempotency_key, fingerprint, make)


def named(query: NamedQuery, names: dict[str, str]) -> NamedQuery:
    """Add subject and label of a form to a query that does not state them.

    Raises
    ------
    RequestValidationError
        If one of them cannot be used.
    """
    stated = query.model_dump(exclude_unset=True)
    try:
        return type(query).model_validate({**names, **stated}) if names else query
    except ValidationError as error:
        raise RequestValidationError(
            [{**item, "loc": ("form", *item["loc"])} for item in error.errors()]
        ) from error


class ListQuery(BaseModel):
    """Which sequences to list."""

    model_config = ConfigDict(extra="forbid")

    subject: str | None = Field(None, max_length=200)
    label: str | None = Field(None, max_length=200)
    limit: int = Field(100, ge=1, le=1000, description="Of one page.")
    cursor: str | None = Field(None, max_length=200, description="Of the page before.")


@router.get("")
def list_sequences(
    query: Annotated[ListQuery, Query()], store: StoreDependency
) -> SequencePageAnswer:
    """List sequences from the newest to the oldest, a page at a time."""
    page = store.list_sequences(**query.model_dump())
    return SequencePageAnswer(
        sequences=[SequenceSummary.of(record) for record in page.records], cursor=page.cursor
    )


@router.post("/sample", response_model=SequenceSummary, include_in_schema=False)
async def sample(state: StateDependency) -> Response:
    """Simulate a heart and keep it, for the first page."""
    return _answer(SequenceSummary.of(await state.analysis.sample()), 200)


@router.get("/{sequence_id}", response_model=SequenceSummary)
def summary(sequence_id: SequenceId, store: StoreDependency, request: Request) -> Response:
    """Give the summary of a stored sequence."""
    answer = _answer(SequenceSummary.of(store.sequence_record(sequence_id)), 200)
    tag = answer.headers["etag"]
    return not_modified(tag) if is_known(request, tag) else answer


@router.patch("/{sequence_id}", response_model=SequenceSummary)
async def change(
    sequence_id: SequenceId, body: SequenceNames, state: StateDependency, request: Request
) -> Response:
    """Change name, subject, label, facts, unit and times: what is left out stays, null removes it.

    Facts are changed as by a JSON merge patch (RFC 7396). Results that depend on a changed fact
    are computed again on request; the others stay. Unit and times are part of the id: another
    sequence takes the place of this one, which is deleted with its results, and the answer and
    Content-Location name the new one. Positions stay as they are.
    """
    stated = body.model_fields_set
    changed: list[str] = []

    def changed_facts(known: Facts) -> Facts:
        if "facts" not in stated:
            return known
        facts = NO_FACTS if body.facts is None else facts_patched(known, body.facts.changes)
        changed.extend(facts.changed(known))
        return facts

    names = {name: getattr(body, name) for name in ("name", "subject", "label") if name in stated}
    current = sequence_id
    if body.restates:
        current = await restate(state, sequence_id, body, changed_facts)
        note_ids(request, [current])
    record = await asyncio.to_thread(
        state.store.update_sequence, current, change=changed_facts, **names
    )
    if current != sequence_id:
        await erase(state, sequence_id)
    note_facts(request, changed)
    answer = _answer(SequenceSummary.of(record), 200)
    answer.headers["Content-Location"] = answer.headers["location"]
    return answer


@router.delete("/{sequence_id}", status_code=204)
async def delete(sequence_id: SequenceId, state: StateDependency) -> None:
    """Delete a sequence with everything that derives from it."""
    await erase(state, sequence_id)


def _answer(summary: SequenceSummary, status: int) -> Response:
    body = summary.model_dump_json()
    headers = {"Location": f"/v1/sequences/{summary.id}", "ETag": tag_of(body)}
    return Response(body, status, headers, "application/json")
