"""Tracks: surfaces followed through clouds, contours, changing meshes and images."""

from __future__ import annotations

import asyncio
import json
from typing import Annotated

from fastapi import Header, Query, Request, Response

from modalmotion.errors import ParameterError
from modalmotion.facts import facts_as_json
from modalmotion.formats import ReadOptions
from modalmotion.store import record_to_json
from modalmotion_service.http.conditional import is_known, not_modified, tag_of
from modalmotion_service.http.gate import note_facts, note_ids
from modalmotion_service.http.json_bodies import JsonRoute
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import HDF5, JSON, PNG, VIEW, best_type
from modalmotion_service.routes.parts.deferral import reply_or_job, result_or_job
from modalmotion_service.routes.parts.dependencies import (
    NamedFileDependency,
    PreferenceDependency,
    StateDependency,
    StoreDependency,
)
from modalmotion_service.routes.parts.idempotency import IdempotencyKey, idempotent_answer
from modalmotion_service.routes.parts.openapi_parts import (
    ACCEPTED,
    BINARY,
    NAMED_UPLOAD_BODY,
    PROBLEMS,
)
from modalmotion_service.routes.sequences import ListQuery, named
from modalmotion_service.schemas import SequenceId
from modalmotion_service.schemas.tracks import (
    TrackAnswer,
    TrackPageAnswer,
    TrackQuery,
    TrackSummary,
    TrackViewQuery,
)
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.erasure import erase
from modalmotion_service.workspace.spool import SpoolFile

router = JudgedRouter(
    prefix="/v1/tracks", tags=["tracks"], responses=PROBLEMS, route_class=JsonRoute
)


@router.post(
    "",
    status_code=201,
    response_model=TrackAnswer,
    openapi_extra=NAMED_UPLOAD_BODY,
    responses={200: {"model": TrackAnswer, "description": "Known already."}, **ACCEPTED},
)
async def track(
    file: NamedFileDependency,
    query: Annotated[TrackQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Track a surface through frames that need not correspond, and store the sequence it makes.

    A zip of one mesh, cloud or set of contours a frame, images, or an npz of points and offsets.
    Of images that were sent to POST /v1/images the id stands in the query, and the body is empty;
    they are deleted once they are tracked. The track has the id of its sequence. It becomes a job
    where it takes longer than the client, or the service, waits.
    """
    query = named(query, file.names)
    form_facts = facts_as_json(file.facts)

    async def make() -> Response:
        sent: Upload | str
        job: dict[str, object] = {
            "query": query.model_dump(mode="json"),
            "facts": form_facts,
            # A job about a sequence ends with it.
            "ids": [] if query.start is None else [query.start],
        }
        if query.images is None:
            sent = Upload(file.path, ReadOptions(limits=state.settings.read_limits))
            job["file"] = file.path.name
        else:
            sent = query.images
        if preference.is_async or state.settings.wait_seconds < state.settings.task_seconds:
            # A job may be acknowledged before the bytes are read: they must outlive a crash.
            await asyncio.to_thread(file.make_durable)
        work = state.tracks.keep(
            sent,
            parameters,
            query.start,
            subject=query.subject,
            label=query.label,
        )
        result = await result_or_job(state, preference, "track", job, work)
        if isinstance(result, Response):
            file.is_left = query.images is None
            return result
        await state.tracks.settle(query.images, result.record.id, is_kept=query.keep)
        note_facts(request, result.filled)
        kept = query.images if query.keep else None
        answer = TrackAnswer.joined(result.estimate, result.record, kept)
        return Response(
            answer.model_dump_json(),
            201 if result.is_new else 200,
            {"Location": answer.links["self"]},
            JSON,
        )

    with file:
        # Before anything is stored for a job.
        parameters = query.parameters(file.facts)
        note_ids(request, [name for name in (query.start, query.images) if name is not None])
        await state.tracks.start_path(query.start)
        if query.images is not None:
            await asyncio.to_thread(require_no_body, file)
            await asyncio.to_thread(state.store.images_record, query.images)
        fingerprint = (
            "POST /v1/tracks",
            file.sha256,
            query.model_dump_json(),
            json.dumps(form_facts),
        )
        return await idempotent_answer(state.idempotency, idempotency_key, fingerprint, make)


def require_no_body(file: SpoolFile) -> None:
    """Refuse a file beside the images that are named."""
    if file.path.stat().st_size:
        raise ParameterError(
            "Images are named, and a file was sent besides.",
            remedy="Leave the body empty, or the images out.",
        )


@router.get("")
def list_tracks(query: Annotated[ListQuery, Query()], store: StoreDependency) -> TrackPageAnswer:
    """List tracks from the newest to the oldest, a page at a time."""
    page = store.list_tracks(**query.model_dump())
    return TrackPageAnswer(
        tracks=[TrackSummary.of_record(record) for record in page.records], cursor=page.cursor
    )


@router.get(
    "/{track_id}",
    response_model=TrackAnswer,
    responses={200: {"content": {HDF5: BINARY, PNG: BINARY, VIEW: BINARY}}, **ACCEPTED},
)
async def view(
    track_id: SequenceId,
    query: Annotated[TrackViewQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
    accept: Annotated[str, Header(description=f"{JSON}, {HDF5}, {PNG} or {VIEW}.")] = JSON,
) -> Response:
    """Give a track: what was found and how well, its HDF5 file, a picture, or data for the page.

    Contours over the images (`picture=overlay`) need images that were kept.
    """
    media_type = best_type(accept, (JSON, HDF5, PNG, VIEW))
    record = state.store.track_record(track_id)
    images_id = await asyncio.to_thread(state.store.images_id_of_track, track_id)
    own = record_to_json(record).decode()
    tag = tag_of(media_type, query.model_dump_json(), own, images_id or "")
    if media_type == PNG and query.picture == "overlay":
        # They may be deleted while somebody has the picture still.
        await asyncio.to_thread(state.store.images_of_track, track_id)
    if is_known(request, tag):
        return not_modified(tag)
    headers = {"ETag": tag, "Vary": "Accept"}
    if media_type == HDF5:
        headers["Content-Disposition"] = f'attachment; filename="{track_id[:12]}-track.h5"'
    body = {"sequence_id": track_id, "query": query, "media_type": media_type}
    return await reply_or_job(state, preference, "track-view", body, headers=headers)


@router.delete("/{track_id}", status_code=204)
async def delete(track_id: SequenceId, state: StateDependency) -> None:
    """Delete a track with its sequence and everything that derives from it."""
    state.store.track_record(track_id)
    await erase(state, track_id)
