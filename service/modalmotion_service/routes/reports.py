"""Reports for hospital systems, for statistics and for people."""

from __future__ import annotations

import asyncio
from typing import Annotated, Final

from fastapi import Header, Query, Request, Response

from modalmotion.reports.dicom import require_space
from modalmotion_service.http.conditional import is_known, not_modified, tag_of
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import CSV, FHIR, PDF, RAW, ZIP, best_type
from modalmotion_service.routes.parts.deferral import in_time, reply_or_job
from modalmotion_service.routes.parts.dependencies import (
    PreferenceDependency,
    RawFileDependency,
    StateDependency,
)
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, BINARY, PROBLEMS, TEXT
from modalmotion_service.routes.parts.temporary_file import temporary_file
from modalmotion_service.schemas import SequenceId
from modalmotion_service.schemas.request_queries import ReportQuery
from modalmotion_service.workspace.models import KeptClassification
from modalmotion_service.workspace.state import State

router = JudgedRouter(prefix="/v1", tags=["reports"], responses=PROBLEMS)


@router.get(
    "/sequences/{sequence_id}/report",
    response_class=Response,
    responses={
        200: {
            "description": "The report.",
            "content": {FHIR: {"schema": {"type": "object"}}, PDF: BINARY, CSV: TEXT},
        },
        **ACCEPTED,
    },
)
async def report(
    sequence_id: SequenceId,
    query: Annotated[ReportQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
    accept: Annotated[str, Header(description=f"{FHIR}, {PDF} or {CSV}.")] = FHIR,
) -> Response:
    """Report on a sequence: a FHIR R4 bundle, a page for people, or a row for each frame.

    Volumes and the share that is lost with their intervals, amplitudes, error, and the kept
    classification of the model that is named. Everything is preliminary; no subject is named.
    The same result is the same bytes: its time is that at which the sequence was kept.
    """
    media_type = best_type(accept, (FHIR, PDF, CSV))
    parameters, facts = state.analysis.resolved(sequence_id, query.parameters())
    known = await _known(state, sequence_id, query)
    said = "" if known is None else f"{known.result.model_id} {known.path.name}"
    tag = tag_of(sequence_id, parameters.key, "report", media_type, repr(facts), said)
    if is_known(request, tag):
        return not_modified(tag)
    body = {"sequence_id": sequence_id, "query": query, "media_type": media_type}
    headers = {"ETag": tag, "Vary": "Accept"}
    return await reply_or_job(state, preference, "report", body, headers=headers)


_INSTANCE: Final = {
    "requestBody": {
        "required": True,
        "description": "Any DICOM instance of the patient's study, as a file.",
        "content": {RAW: BINARY},
    }
}


@router.post(
    "/sequences/{sequence_id}/dicom",
    response_class=Response,
    openapi_extra=_INSTANCE,
    responses={200: {"description": "The objects.", "content": {ZIP: BINARY}}},
)
async def dicom(
    sequence_id: SequenceId,
    file: RawFileDependency,
    query: Annotated[ReportQuery, Query()],
    state: StateDependency,
) -> Response:
    """Write a report as DICOM objects of a study: a zip with a structured report and surfaces.

    The structured report follows TID 1500; surfaces, at the ends of diastole and systole, are
    encapsulated STL. Patient and study are copied from the header of the instance in the body,
    whose pixels are not read; nothing of it is kept or logged, so no job does this. Refused where
    coordinates are not stated to be LPS, in mm. The same result and study are the same bytes.
    """
    with file:
        parameters, facts = state.analysis.resolved(sequence_id, query.parameters())
        require_space(facts, state.store.sequence_record(sequence_id).unit)
        known = await _known(state, sequence_id, query)
        path = None if known is None else known.path
        limits = state.settings.read_limits
        work = state.analysis.dicom(sequence_id, parameters, path, file.path, limits)
        output = await in_time(state, work)
    name = f'attachment; filename="{sequence_id[:12]}-dicom.zip"'
    return temporary_file(output, ZIP, headers={"Content-Disposition": name})


async def _known(state: State, sequence_id: str, query: ReportQuery) -> KeptClassification | None:
    if query.model is None:
        return None
    return await asyncio.to_thread(state.models.known_classification, sequence_id, query.model)
