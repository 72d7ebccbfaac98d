"""Modal signatures: of one sequence, and of many in one answer."""

from __future__ import annotations

import json
from typing import Annotated

from fastapi import Header, Query, Request, Response
from starlette.responses import FileResponse

from modalmotion.errors import LimitError, ParameterError
from modalmotion.facts import facts_as_json
from modalmotion_service.http.conditional import is_known, not_modified, tag_of
from modalmotion_service.http.gate import note_ids
from modalmotion_service.http.json_bodies import JsonRoute
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import CSV, HDF5, JSON, NPZ, best_type
from modalmotion_service.routes.parts.deferral import reply_or_job, result_or_job
from modalmotion_service.routes.parts.dependencies import PreferenceDependency, StateDependency
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, BINARY, PROBLEMS, TEXT
from modalmotion_service.routes.parts.signature_types import SIGNATURE_CONTENT, SIGNATURE_TYPES
from modalmotion_service.routes.parts.temporary_file import temporary_file
from modalmotion_service.schemas import (
    DistanceAnswer,
    ManySignatures,
    SequenceId,
    SignatureAnswer,
    SignatureQuery,
    parse_times,
)
from modalmotion_service.schemas.request_queries import DistanceQuery, ReconstructionQuery
from modalmotion_service.workspace.reply_kinds import SURFACES

router = JudgedRouter(prefix="/v1", tags=["signatures"], responses=PROBLEMS, route_class=JsonRoute)


@router.get(
    "/sequences/{sequence_id}/signature",
    response_model=SignatureAnswer,
    responses={200: {"content": SIGNATURE_CONTENT}, **ACCEPTED},
)
async def signature(
    sequence_id: SequenceId,
    query: Annotated[SignatureQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
    accept: Annotated[str, Header(description=", ".join(SIGNATURE_TYPES))] = JSON,
) -> Response:
    """Give the modal signature: amplitudes, error, spectrum, energy and its file.

    As JSON, the result's HDF5 file, npz, a picture of it beside the surfaces, a table with a row
    for each frame, mode and direction, or the amplitudes alone as little-endian float32, by
    `Accept`.
    """
    media_type = best_type(accept, SIGNATURE_TYPES)
    parameters, facts = state.analysis.resolved(sequence_id, query.parameters())
    # A result never changes once its sequence and its parameters are named; facts may.
    shows_facts = facts.stated and media_type in (JSON, HDF5)
    shown = (json.dumps(facts_as_json(facts)),) if shows_facts else ()
    tag = tag_of(sequence_id, parameters.key, media_type, *shown)
    if is_known(request, tag):
        return not_modified(tag)
    job_request = {"sequence_id": sequence_id, "query": query.model_dump(mode="json")}
    work = state.analysis.signature(sequence_id, parameters)
    result = await result_or_job(state, preference, "signature", job_request, work)
    if isinstance(result, Response):
        return result
    headers = {"ETag": tag, "Vary": "Accept"}
    name = f"{sequence_id[:12]}-signature.h5"
    if media_type == HDF5 and not shown:
        return FileResponse(result, media_type=HDF5, filename=name, headers=headers)
    if media_type == HDF5:
        headers["Content-Disposition"] = f'attachment; filename="{name}"'
    body = {"sequence_id": sequence_id, "query": query, "media_type": media_type}
    return await reply_or_job(state, preference, "signature-view", body, headers=headers)


@router.get("/sequences/{sequence_id}/distance", response_model=DistanceAnswer, responses=ACCEPTED)
async def distance(
    sequence_id: SequenceId,
    query: Annotated[DistanceQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
) -> Response:
    """Give the distance of a sequence's signature from another's: 0 for the same motion."""
    note_ids(request, [query.to])
    ids = [sequence_id, query.to]
    for known in ids:
        state.store.sequence_record(known)
    return await reply_or_job(state, preference, "distance", {"ids": ids, "query": query})


@router.get(
    "/sequences/{sequence_id}/reconstruction",
    response_class=Response,
    responses={
        200: {"description": "The surfaces.", "content": dict.fromkeys(SURFACES, BINARY)},
        **ACCEPTED,
    },
)
async def reconstruction(
    sequence_id: SequenceId,
    query: Annotated[ReconstructionQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
    accept: Annotated[str, Header(description=", ".join(SURFACES))] = NPZ,
) -> Response:
    """Give the surfaces that a signature describes, at any times or phases of the cycle."""
    media_type = best_type(accept, tuple(SURFACES))
    state.store.sequence_record(sequence_id)
    chosen = [one for one in (query.times, query.phases) if one is not None]
    for text in chosen:
        parse_times(text)
    if len(chosen) + (query.frames is not None) > 1:
        raise ParameterError(
            "Several of times, phases and frames came.", remedy="Give one of them."
        )
    body = {"sequence_id": sequence_id, "query": query, "media_type": media_type}
    return await reply_or_job(state, preference, "reconstruction", body)


@router.post(
    "/signatures/query",
    response_class=Response,
    responses={
        200: {
            "description": "All trajectories.",
            "content": {NPZ: BINARY, HDF5: BINARY, CSV: TEXT},
        },
        **ACCEPTED,
    },
)
async def signatures(
    query: ManySignatures,
    http_request: Request,
    state: StateDependency,
    preference: PreferenceDependency,
    accept: Annotated[str, Header(description=f"{NPZ}, {HDF5} or {CSV}.")] = NPZ,
) -> Response:
    """Give the signatures of many sequences in one file, in the order of their ids.

    As a table (CSV) each sequence has a row: errors, volumes, ejection fraction, the RMS of each
    amplitude.
    """
    media_type = best_type(accept, (NPZ, HDF5, CSV))
    most = state.settings.max_query_ids
    if len(query.ids) > most:
        raise LimitError(
            f"{len(query.ids)} signatures were requested at once; the limit is {most}.",
            remedy="Ask for them in several requests.",
            limit="query_ids",
            details={"value": len(query.ids), "most": most},
        )
    note_ids(http_request, query.ids)
    for sequence_id in query.ids:
        state.store.sequence_record(sequence_id)
    job_request = {**query.model_dump(mode="json"), "media_type": media_type}
    work = state.analysis.pack(query.ids, query.parameters(), media_type)
    result = await result_or_job(state, preference, "signatures", job_request, work)
    if isinstance(result, Response):
        return result
    suffix = {HDF5: "h5", NPZ: "npz", CSV: "csv"}[media_type]
    return temporary_file(result, media_type, filename=f"signatures.{suffix}")
