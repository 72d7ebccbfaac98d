"""Images that are taken in, and tracks: surfaces followed through what does not correspond."""

import asyncio
from typing import Annotated

from fastapi import Depends, Query, Response

from modalmotion import errors, store
from modalmotion_service.http.gated_router import GatedRouter
from modalmotion_service.http.negotiation import HDF5, JSON, PNG, VIEW
from modalmotion_service.routes.asked import AskedAny, AskedNow, IdempotencyKey, answers
from modalmotion_service.routes.uploads import Sent, receiving
from modalmotion_service.schemas import from_core, queries, requests
from modalmotion_service.schemas.sequences import ImagesPageAnswer, ImagesSummary, TrackAnswer
from modalmotion_service.workspace import models, recording_operations, spool
from modalmotion_service.workspace import recording_operations as operations
from modalmotion_service.workspace.operation import Request

router = GatedRouter(prefix="/v1")


@router.post("/images", tags=["images"], **answers(of=ImagesSummary, is_new=True))
async def upload_images(
    sent: Annotated[Sent, Depends(receiving(requests.ImagesStatements))],
    asked: AskedAny,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Upload images to be tracked: NIfTI, NRRD, MetaImage, or a zip of DICOM slices or of such.

    Samples, places and times are kept; names and headers are not, nor is the file. They are
    deleted once they are tracked, if they are not kept on purpose.
    """
    with sent.file as file:
        return await asked.do(operations.images, Request(), file=file, key=idempotency_key)


@router.get("/images", tags=["images"])
def list_images(query: Annotated[from_core.Paging, Query()], asked: AskedNow) -> ImagesPageAnswer:
    """List images from the newest to the oldest, a page at a time."""
    page, cursor = asked.store.list_images(**query.model_dump())
    return ImagesPageAnswer(images=[ImagesSummary.of(record) for record in page], cursor=cursor)


@router.get("/images/{images_id}", tags=["images"], **answers(JSON, VIEW, of=ImagesSummary))
async def describe_images(
    images_id: from_core.SequenceId, query: Annotated[queries.ImagesView, Query()], asked: AskedAny
) -> Response:
    """Describe images: shape, spacing, times and kind, and nothing of whom they show.

    With `frame` the slices of one frame, for the page `/images/{images_id}`: large planes and
    volumes are thinned, for landmarks are placed on them and nothing is measured.
    """
    record = asked.store.images_record(images_id)
    if query.frame is None:
        return asked.json(ImagesSummary.of(record))
    if query.track is not None:
        asked.store.track_record(query.track)
    ids = tuple(one for one in (images_id, query.track) if one is not None)
    asked.note(query.track)
    return await asked.do(operations.slices, Request(query=query, ids=ids))


@router.delete("/images/{images_id}", tags=["images"], status_code=204)
async def delete_images(images_id: from_core.SequenceId, asked: AskedNow) -> None:
    """Delete images; a track that is under way in them ends, and those that were made stay."""
    await recording_operations.erase_images(asked.state, images_id)


@router.post("/tracks", tags=["tracks"], **answers(of=TrackAnswer, is_new=True))
async def track_recording(
    sent: Annotated[Sent, Depends(receiving(requests.TRACK, is_optional=True))],
    asked: AskedAny,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Track a surface through frames that need not correspond, and store the sequence it makes.

    A zip of one mesh, cloud or set of contours a frame, images, or an npz of points and offsets. Of
    images that were sent to POST /v1/images the id is stated, and the body is empty; they are
    deleted once they are tracked. The track has the id of its sequence, with which it is deleted.

    With `report` it is a job, whose result is a zip with the report for people (PDF), for systems
    (FHIR) and for statistics (CSV), and a page on which the surface moves; with `model` its class
    is named and stored, too.
    """
    query = sent.query
    with sent.file as file:
        # Before anything is stored for a job.
        query.parameters(file.facts)
        asked.note(query.start, query.images)
        await operations.start_path(asked.state, query.start)
        if query.model is not None:
            await asyncio.to_thread(models.choose, asked.state, query.model)
        own: spool.SpoolFile | None = file
        if query.images is not None:
            if (await asyncio.to_thread(file.path.stat)).st_size:
                raise errors.ParameterError(
                    "Images are named, and a file was sent besides.",
                    remedy="Leave the body empty, or the images out.",
                )
            await asyncio.to_thread(asked.store.images_record, query.images)
            own = None
        # A job about a sequence ends with it.
        ids = () if query.start is None else (query.start,)
        request = Request(query=query, ids=ids, facts=file.facts)
        what = operations.tracked_report if query.report else operations.track
        return await asked.do(what, request, file=own, key=idempotency_key)


@router.get("/tracks/{track_id}", tags=["tracks"], **answers(JSON, HDF5, PNG, VIEW, of=TrackAnswer))
async def show_track(
    track_id: from_core.SequenceId, query: Annotated[queries.TrackView, Query()], asked: AskedAny
) -> Response:
    """Give a track: what was found and how well, its HDF5 file, a picture, or data for the page.

    Contours over the images (`picture=overlay`) need images that were kept.
    """
    kind = asked.media_type(*operations.track_view.media_types)
    record = asked.store.track_record(track_id)
    images_id = await asyncio.to_thread(asked.store.images_id_of_track, track_id)
    if kind == PNG and query.picture == "overlay":
        # They may be deleted while somebody has the picture still.
        await asyncio.to_thread(asked.store.images_of_track, track_id)
    own = store.record_to_json(record).decode()
    request = Request(query=query, media_type=kind, sequence_id=track_id)
    return await asked.do(operations.track_view, request, tag=(own, images_id or ""))
