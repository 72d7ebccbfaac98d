"""Images: sent, described, deleted; tracked by POST /v1/tracks."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import Path, Query, Request, Response

from modalmotion.formats import ReadOptions
from modalmotion_service.http.conditional import is_known, not_modified, tag_of
from modalmotion_service.http.json_bodies import JsonRoute
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import JSON, VIEW
from modalmotion_service.routes.parts.deferral import reply_or_job, result_or_job
from modalmotion_service.routes.parts.dependencies import (
    BareFileDependency,
    PreferenceDependency,
    StateDependency,
    StoreDependency,
)
from modalmotion_service.routes.parts.idempotency import IdempotencyKey, idempotent_answer
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, BINARY, FILE_BODY, PROBLEMS
from modalmotion_service.schemas import SequenceId
from modalmotion_service.schemas.images import (
    ImagesListQuery,
    ImagesPageAnswer,
    ImagesSummary,
    SlicesQuery,
)
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.erasure import erase_images
from modalmotion_service.workspace.images import link_of

router = JudgedRouter(
    prefix="/v1/images", tags=["images"], responses=PROBLEMS, route_class=JsonRoute
)


@router.post(
    "",
    status_code=201,
    response_model=ImagesSummary,
    openapi_extra=FILE_BODY,
    responses={200: {"model": ImagesSummary, "description": "Known already."}, **ACCEPTED},
)
async def upload(
    file: BareFileDependency,
    state: StateDependency,
    preference: PreferenceDependency,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Take in images to be tracked: NIfTI, NRRD, MetaImage, or a zip of DICOM slices or of such.

    Samples, places and times are kept; names and headers are not, nor is the file. They are
    deleted once they are tracked, if they are not kept on purpose.
    """

    async def make() -> Response:
        sent = Upload(file.path, ReadOptions(limits=state.settings.image_limits))
        if preference.is_async or state.settings.wait_seconds < state.settings.task_seconds:
            # A job may be acknowledged before the bytes are read: they must outlive a crash.
            await asyncio.to_thread(file.make_durable)
        work = state.images.take(sent)
        job = {"file": file.path.name}
        result = await result_or_job(state, preference, "images", job, work)
        if isinstance(result, Response):
            file.is_left = True
            return result
        record, is_new = result
        body = ImagesSummary.of(record).model_dump_json()
        return Response(body, 201 if is_new else 200, {"Location": link_of(record.id)}, JSON)

    with file:
        fingerprint = ("POST /v1/images", file.sha256)
        return await idempotent_answer(state.idempotency, idempotency_key, fingerprint, make)


@router.get("")
def list_images(
    query: Annotated[ImagesListQuery, Query()], store: StoreDependency
) -> ImagesPageAnswer:
    """List images from the newest to the oldest, a page at a time."""
    page = store.list_images(**query.model_dump())
    return ImagesPageAnswer(
        images=[ImagesSummary.of(record) for record in page.records], cursor=page.cursor
    )


@router.get("/{images_id}", response_model=ImagesSummary)
def describe(images_id: SequenceId, store: StoreDependency, request: Request) -> Response:
    """Describe images: shape, spacing, times and kind, and nothing of whom they show."""
    body = ImagesSummary.of(store.images_record(images_id)).model_dump_json()
    tag = tag_of(body)
    return not_modified(tag) if is_known(request, tag) else Response(body, 200, {"ETag": tag}, JSON)


@router.get(
    "/{images_id}/frames/{frame}",
    response_class=Response,
    responses={
        200: {"description": "What the page reads.", "content": {VIEW: BINARY}},
        **ACCEPTED,
    },
)
async def slices(
    images_id: SequenceId,
    frame: Annotated[int, Path(ge=0, description="From 0.")],
    query: Annotated[SlicesQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
) -> Response:
    """Give one frame's slices in 256 shades, for `/images/{images_id}`.

    Large planes and volumes are thinned: landmarks are placed on them, nothing is measured.
    """
    state.store.images_record(images_id)
    ids = [images_id]
    if query.track is not None:
        state.store.track_record(query.track)
        ids.append(query.track)
    body = {"ids": ids, "frame": frame}
    return await reply_or_job(state, preference, "slices", body)


@router.delete("/{images_id}", status_code=204)
async def delete(images_id: SequenceId, state: StateDependency) -> None:
    """Delete images; a track that is under way in them ends, and those that were made stay."""
    await erase_images(state, images_id)
