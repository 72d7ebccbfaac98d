"""Templates: natural coordinates that many sequences of one mesh share."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import Depends, Query, Response

from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import HDF5, JSON, NPZ, PNG
from modalmotion_service.routes.asked import AskedAny, AskedNow, page_of
from modalmotion_service.routes.described import answers, upload
from modalmotion_service.routes.uploads import Sent, receiving
from modalmotion_service.schemas.from_core import Paging, SequenceId
from modalmotion_service.schemas.requests import SIGNATURE_OF_FILE, ModesRequest
from modalmotion_service.schemas.signatures import ModesAnswer, TemplateAnswer, TemplatePageAnswer
from modalmotion_service.workspace import sequence_operations as operations
from modalmotion_service.workspace.operation import Request

router = JudgedRouter(prefix="/v1/templates", tags=["templates"])


@router.post("", **answers(of=TemplateAnswer, is_new=True), **upload(SIGNATURE_OF_FILE))
async def make_template(
    sent: Annotated[Sent, Depends(receiving(SIGNATURE_OF_FILE))], asked: AskedAny
) -> Response:
    """Make the template of a sequence's reference frame, and store it.

    A cohort whose vertices correspond names it (`template`) and pays for it once.
    """
    with sent.file as file:
        sent.query.parameters()
        return await asked.do(operations.template, Request(query=sent.query), file=file)


@router.get("", response_model=TemplatePageAnswer)
async def list_templates(query: Annotated[Paging, Query()], asked: AskedNow) -> TemplatePageAnswer:
    """List the ids of templates, sorted, a page at a time."""
    ids = await asyncio.to_thread(asked.store.templates)
    page, cursor = page_of(list(ids), query.limit, query.cursor)
    return TemplatePageAnswer(templates=page, cursor=cursor)


@router.get("/{template_id}", **answers(JSON, PNG, of=TemplateAnswer))
async def describe_template(template_id: SequenceId, asked: AskedAny) -> Response:
    """Describe a template, or draw s and theta on its surface."""
    kind = asked.media_type(JSON, PNG)
    asked.store.template_path(template_id)
    request = Request(media_type=kind, reference=template_id)
    return await asked.do(operations.template_view, request, tag=asked.tagged(template_id, kind))


@router.get("/{template_id}/modes", **answers(JSON, NPZ, HDF5, PNG, of=ModesAnswer))
async def modes_of_template(
    template_id: SequenceId, query: Annotated[ModesRequest, Query()], asked: AskedAny
) -> Response:
    """Give the vibration modes of a template: labels, angular frequencies and shapes.

    Shapes come as npz or HDF5, or in JSON with `shapes=true`; a picture shows them in colour.
    """
    kind = asked.media_type(JSON, NPZ, HDF5, PNG)
    asked.store.template_path(template_id)
    request = Request(query=query, media_type=kind, reference=template_id)
    tag = asked.tagged(template_id, query.model_dump_json(), kind)
    return await asked.do(operations.template_modes, request, tag=tag)


@router.delete("/{template_id}", status_code=204)
async def delete_template(template_id: SequenceId, asked: AskedNow) -> None:
    """Delete a template, and with it the reference vertices that it holds.

    Signatures that were fitted on it stay; they can no longer be reconstructed.
    """
    await asyncio.to_thread(asked.store.delete_template, template_id)
