"""Templates: natural coordinates that many sequences of one mesh share."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import Header, Query, Request, Response

from modalmotion_service.http.conditional import is_known, not_modified, tag_of
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import HDF5, JSON, NPZ, PNG, best_type
from modalmotion_service.routes.parts.deferral import reply_or_job, result_or_job
from modalmotion_service.routes.parts.dependencies import (
    FileDependency,
    PreferenceDependency,
    StateDependency,
)
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, BINARY, PROBLEMS, UPLOAD_BODY
from modalmotion_service.schemas import (
    ModesAnswer,
    ModesQuery,
    SequenceId,
    TemplateAnswer,
    TemplateList,
)
from modalmotion_service.schemas.request_queries import TemplateQuery
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.reply_kinds import as_json

router = JudgedRouter(prefix="/v1/templates", tags=["templates"], responses=PROBLEMS)


@router.post(
    "",
    status_code=201,
    response_model=TemplateAnswer,
    openapi_extra=UPLOAD_BODY,
    responses={200: {"model": TemplateAnswer, "description": "Known already."}, **ACCEPTED},
)
async def make(
    file: FileDependency,
    query: Annotated[TemplateQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
) -> Response:
    """Make the template of a sequence's reference frame, and store it.

    A cohort whose vertices correspond names it (`?template=`) and pays for it once.
    """
    request = {"file": file.path.name, "query": query, "facts": file.facts}
    with file:
        sent = Upload(file.path, query.options(state.settings.read_limits, file.facts))
        work = state.analysis.template(sent, query.parameters())
        result = await result_or_job(
            *(state, preference, "template", lambda: as_json(request), work),
            leave=lambda _: asyncio.to_thread(file.make_durable),
        )
        if isinstance(result, Response):
            file.is_left = True
            return result
    answer, is_new = result
    return Response(
        answer.model_dump_json(),
        201 if is_new else 200,
        {"Location": answer.links["self"], "ETag": tag_of(answer.id, JSON)},
        JSON,
    )


@router.get("")
async def list_templates(state: StateDependency) -> TemplateList:
    """List the ids of all templates."""
    ids = await asyncio.to_thread(state.store.templates)
    return TemplateList(templates=list(ids))


@router.get(
    "/{template_id}",
    response_model=TemplateAnswer,
    responses={200: {"content": {PNG: BINARY}}, **ACCEPTED},
)
async def describe(
    template_id: SequenceId,
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
    accept: Annotated[str, Header(description=f"{JSON}, or {PNG} for a picture.")] = JSON,
) -> Response:
    """Describe a template, or draw s and theta on its surface."""
    media_type = best_type(accept, (JSON, PNG))
    state.store.template_path(template_id)
    tag = tag_of(template_id, media_type)
    if is_known(request, tag):
        return not_modified(tag)
    body = {"template_id": template_id, "media_type": media_type}
    headers = {"ETag": tag, "Vary": "Accept"}
    return await reply_or_job(state, preference, "template-view", body, headers=headers)


@router.get(
    "/{template_id}/modes",
    response_model=ModesAnswer,
    responses={200: {"content": {NPZ: BINARY, HDF5: BINARY, PNG: BINARY}}, **ACCEPTED},
)
async def modes(
    template_id: SequenceId,
    query: Annotated[ModesQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
    accept: Annotated[str, Header(description=f"{JSON}, {NPZ}, {HDF5} or {PNG}.")] = JSON,
) -> Response:
    """Give the vibration modes of a surface: labels, angular frequencies and shapes.

    Shapes come as npz or HDF5, or in JSON with `shapes=true`; a picture shows them in colour.
    """
    media_type = best_type(accept, (JSON, NPZ, HDF5, PNG))
    state.store.template_path(template_id)
    tag = tag_of(template_id, "modes", query.model_dump_json(), media_type)
    if is_known(request, tag):
        return not_modified(tag)
    body = {"template_id": template_id, "query": query, "media_type": media_type}
    headers = {"ETag": tag, "Vary": "Accept"}
    return await reply_or_job(state, preference, "template-modes", body, headers=headers)


@router.delete("/{template_id}", status_code=204)
async def delete(template_id: SequenceId, state: StateDependency) -> None:
    """Delete a template, and with it the reference vertices that it holds.

    Signatures that were fitted on it stay; they can no longer be reconstructed.
    """
    await asyncio.to_thread(state.store.delete_template, template_id)
