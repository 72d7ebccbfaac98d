"""Signatures of stored sequences: made, listed, shown, deleted; and what follows from them."""

import asyncio
import contextlib
import json
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Final

from fastapi import Depends, Query, Response
from fastapi import Request as HttpRequest

from modalmotion.errors import LimitError, NotFoundError
from modalmotion.mesh import facts_as_json
from modalmotion.reports.dicom import require_space
from modalmotion_service.errors import BusyError
from modalmotion_service.http.gated_router import GatedRouter, body_of
from modalmotion_service.http.negotiation import CSV, HTML, JSON, PNG, RAW, VIEW, ZIP, attachment
from modalmotion_service.http.observation import stage
from modalmotion_service.routes.asked import (
    Asked,
    AskedAny,
    AskedNow,
    answers,
    get_state,
    page_of,
    temporary_file,
)
from modalmotion_service.schemas import queries, requests, results
from modalmotion_service.schemas import signatures as shown
from modalmotion_service.schemas.from_core import Paging, SequenceId, SignatureKey
from modalmotion_service.schemas.models import FeaturesAnswer
from modalmotion_service.work.tasks import signatures
from modalmotion_service.workspace import model_operations as of_models
from modalmotion_service.workspace import models, spool
from modalmotion_service.workspace import signature_operations as operations
from modalmotion_service.workspace.analysis import USUAL, with_facts
from modalmotion_service.workspace.models import KeptClassification
from modalmotion_service.workspace.operation import Operation, Request
from modalmotion_service.workspace.signature_operations import SIGNATURE_TYPES, SURFACES

router = GatedRouter(prefix="/v1", tags=["signatures"])

_DICOM: Final = {
    "requestBody": {
        "required": True,
        "description": "Any DICOM instance of the patient's study, as a file.",
        "content": {RAW: {"schema": {"type": "string", "format": "binary"}}},
    }
}


@router.post(
    "/sequences/{sequence_id}/signatures",
    **answers(*SIGNATURE_TYPES, of=shown.SignatureAnswer, is_new=True),
)
async def make_signature(
    sequence_id: SequenceId,
    wanted: Annotated[requests.SignatureRequest, Depends(body_of(requests.SIGNATURE))],
    asked: AskedAny,
) -> Response:
    """Make a signature of a sequence, and store it.

    201 where it is new, 200 where it is known: the same parameters have the same key. Without a
    body it is the one of seven modes.
    """
    asked.state.analysis.resolved(sequence_id, wanted.parameters())
    asked.note(wanted.parameters().template)
    return await asked.do(operations.signature, Request(query=wanted, sequence_id=sequence_id))


@router.get("/sequences/{sequence_id}/signatures")
async def list_signatures(
    sequence_id: SequenceId, query: Annotated[Paging, Query()], asked: AskedNow
) -> shown.SignaturePageAnswer:
    """List the stored signatures of a sequence, by their keys."""
    keys = await asyncio.to_thread(asked.store.signatures, sequence_id)
    page, cursor = page_of(list(keys), query.limit, query.cursor)
    rendered = asked.state.analysis.rendered
    texts = [await rendered(sequence_id, key) for key in page]
    return shown.SignaturePageAnswer(
        signatures=[*map(shown.SignatureSummary.of, texts)], cursor=cursor
    )


@router.get(
    "/sequences/{sequence_id}/signature", **answers(*SIGNATURE_TYPES, of=shown.SignatureAnswer)
)
async def usual_signature(sequence_id: SequenceId, asked: AskedAny) -> Response:
    """Give the usual signature of a sequence: seven modes.

    As it is stored, or fitted for this answer alone; nothing is stored by it.
    """
    return await show_signature(sequence_id, asked)


@router.get("/signatures/{key}", **answers(*SIGNATURE_TYPES, of=shown.SignatureAnswer))
async def show_signature(key: SignatureKey, asked: AskedAny) -> Response:
    """Give a signature: amplitudes, errors, spectrum and energy.

    As JSON, its HDF5 file, npz, a picture beside the surfaces, a table with a row for each frame,
    mode and direction, or the amplitudes alone as little-endian float32, by `Accept`.
    """
    return await _shown(asked, operations.signature_view, key)


@router.delete("/signatures/{key}", status_code=204)
async def delete_signature(key: SignatureKey, asked: AskedNow) -> None:
    """Delete a signature; classes that were named of it stay."""
    sequence_id, _, own = key.partition("-")
    await asyncio.to_thread(asked.store.delete_signature, sequence_id, own)


@router.get("/signatures/{key}/readouts", **answers(JSON, PNG, CSV, of=results.ReadoutsAnswer))
async def read_signature(key: SignatureKey, asked: AskedAny) -> Response:
    """Give the clinical read-outs of a signature: volumes, rates, strain, each with its interval.

    Surfaces that enclose nothing are refused (422). The share that is lost is an ejection fraction
    where the fact `cavity` is stated or the surface is a cup, else a volume change.
    """
    return await _shown(asked, operations.readouts, key)


@router.get("/signatures/{key}/strain", **answers(of=results.StrainAnswer))
async def strain_of_signature(key: SignatureKey, asked: AskedAny) -> Response:
    """Give the strain of the wall that a signature describes: GLS, GCS, GAS, segments."""
    return await _shown(asked, operations.strain, key)


@router.get("/signatures/{key}/table", **answers(CSV))
async def table_of_signature(key: SignatureKey, asked: AskedAny) -> Response:
    """Give the amplitudes of a signature as a table, a row for each frame, mode and direction."""
    return await _shown(asked, operations.signature_view, key, CSV)


@router.get("/signatures/{key}/reconstruction", **answers(*SURFACES))
async def reconstruct_signature(
    key: SignatureKey, query: Annotated[queries.Reconstruction, Query()], asked: AskedAny
) -> Response:
    """Give the surfaces that a signature describes, at any times or phases of the cycle."""
    query.instants()
    return await _shown(asked, operations.reconstruction, key, query=query)


@router.get("/signatures/{key}/report", **answers(*operations.report.media_types))
async def report_signature(
    key: SignatureKey, query: Annotated[queries.ReportRequest, Query()], asked: AskedAny
) -> Response:
    """Report on a signature: a FHIR R4 bundle, a page for people, or a row for each frame.

    Volumes and the share that is lost with their intervals, amplitudes, error, and the kept
    classification of the model that is named. Everything is preliminary; no subject is named.
    The same result is the same bytes: its time is that at which the sequence was kept.
    """
    known = await _known(asked, key, query)
    said = "" if known is None else f"{known.result.model_id} {known.path.name}"
    return await _shown(asked, operations.report, key, query=query, also=said)


async def _instance(request: HttpRequest) -> spool.SpoolFile:
    state = await get_state(request)
    with stage("receive"):
        file = await state.spool.receive(request.stream(), hashed=False)
    request.state.remove_upload = file.remove
    return file


@router.post(
    "/signatures/{key}/dicom",
    **answers(ZIP, waits=False),
    openapi_extra=_DICOM,
    # Where the extra is absent it is answered 501.
    include_in_schema=find_spec("highdicom") is not None,
)
async def dicom_of_signature(
    key: SignatureKey,
    file: Annotated[spool.SpoolFile, Depends(_instance)],
    query: Annotated[queries.ReportRequest, Query()],
    asked: AskedNow,
) -> Response:
    """Report on a signature as DICOM objects of a study: a zip of a report and surfaces.

    The structured report follows TID 1500; surfaces, at the ends of diastole and systole, are
    encapsulated STL. Patient and study are copied from the header of the instance in the body,
    whose pixels are not read; nothing of it is kept or logged, so no job does this. Refused where
    coordinates are not stated to be LPS, in mm. The same result and study are the same bytes.
    """
    with file:
        analysis, wait = asked.state.analysis, asked.state.settings.wait_seconds
        sequence_id = _sequence_of(asked, key)
        record = asked.store.sequence_record(sequence_id)
        require_space(record.facts, record.unit)
        known = await _known(asked, key, query)
        classified = None if known is None else known.path

        async def made() -> Path:
            async with analysis.fitted(sequence_id, key.partition("-")[2] or None) as one:
                limits = asked.state.settings.read_limits
                return await analysis.written(
                    signatures.make_dicom, one, file.path, limits, classified
                )

        try:
            async with asyncio.timeout(wait):
                output = await asked.unless_left(made())
        except TimeoutError:
            raise BusyError(
                f"The workers did not come to this within {wait:g} s.",
                remedy="Wait a little and send it again.",
                limit="wait_seconds",
                details={"most": wait},
            ) from None
    return temporary_file(output, ZIP, attachment(f"{sequence_id[:12]}-dicom.zip"))


@router.get("/signatures/{key}/view", **answers(VIEW, HTML))
async def view_signature(
    key: SignatureKey, query: Annotated[queries.ViewRequest, Query()], asked: AskedAny
) -> Response:
    """Give what the page `/view/{key}` shows of a signature, or the page as one file.

    The file opens from disk, without a network. In the other form are the reference, its natural
    coordinates, the amplitudes, volume and segments; `first` and `stop` give frames as they were
    sent, in 65,536 steps of their box.
    """
    return await _shown(asked, operations.view, key, query=query)


@router.get("/signatures/{key}/distance", **answers(of=shown.DistanceAnswer))
async def compare_signature(
    key: SignatureKey, query: Annotated[queries.DistanceRequest, Query()], asked: AskedAny
) -> Response:
    """Give the distance of a signature from another: 0 for the same motion."""
    other = query.to.partition("-")[0]
    asked.note(other)
    asked.store.sequence_record(other)
    return await _shown(asked, operations.distance, key, query=query, ids=(other,))


@router.post(
    "/signatures/{key}/classifications", **answers(of=results.ClassificationAnswer, is_new=True)
)
async def classify_signature(
    key: SignatureKey,
    wanted: Annotated[
        requests.ClassificationRequest,
        Depends(body_of(requests.ClassificationRequest)),
    ],
    asked: AskedAny,
) -> Response:
    """Name the class of the motion that a signature describes.

    201 where the answer is new, 200 where it was known. Where the model reads other modes than this
    signature has, those are fitted and stored on the way.
    """
    sequence_id = _sequence_of(asked, key)
    model = await asyncio.to_thread(models.choose_for, asked.state, wanted.model, sequence_id)
    # By its version: a newer one may exist when the job is resumed.
    reference = str(model.reference)
    request = Request(query=wanted, sequence_id=sequence_id, reference=reference)
    return await asked.do(operations.classification, request)


@router.get("/signatures/{key}/classifications")
async def list_classifications(
    key: SignatureKey, query: Annotated[Paging, Query()], asked: AskedNow
) -> results.ClassificationPageAnswer:
    """List the classes that models have named of a sequence's motion, by model."""
    sequence_id = _sequence_of(asked, key)
    found = await asyncio.to_thread(models.classifications, asked.state, sequence_id)
    kept = {f"{one.result.model_id} {one.path.name}": one for one in found}
    page, cursor = page_of(sorted(kept), query.limit, query.cursor)
    answers = [operations.classification_answer(asked.state, kept[name]) for name in page]
    return results.ClassificationPageAnswer(classifications=answers, cursor=cursor)


@router.post("/signatures/query", **answers(*operations.signatures_query.media_types))
async def pack_signatures(
    wanted: Annotated[requests.ManySignatures, Depends(body_of(requests.MANY_SIGNATURES))],
    asked: AskedAny,
) -> Response:
    """Give the signatures of many sequences in one file, in the order of their ids.

    As a table (CSV) each sequence has a row: errors, volumes, ejection fraction, the RMS of each
    amplitude. Missing ones are fitted and stored on the way.
    """
    most = asked.state.settings.max_query_ids
    if len(wanted.ids) > most:
        raise LimitError(
            f"{len(wanted.ids)} signatures were requested at once; the limit is {most}.",
            remedy="Ask for them in several requests.",
            limit="query_ids",
            details={"value": len(wanted.ids), "most": most},
        )
    asked.note(*wanted.ids)
    wanted.parameters()
    for sequence_id in wanted.ids:
        asked.store.sequence_record(sequence_id)
    request = Request(query=wanted, ids=tuple(wanted.ids))
    return await asked.do(operations.signatures_query, request)


@router.post("/features", **answers(JSON, CSV, of=FeaturesAnswer))
async def tabulate_features(
    wanted: Annotated[queries.FeaturesRequest, Depends(body_of(queries.FeaturesRequest))],
    asked: AskedAny,
) -> Response:
    """Give the features of stored sequences as a table: a line for each.

    They do not depend on pose, unit, start or sampling. Missing signatures are fitted and stored on
    the way, in modes that all the sequences share.
    """
    return await asked.do(of_models.features, await asked.about(wanted, queries.FeatureOptions))


def _sequence_of(asked: Asked, key: str) -> str:
    """Sequence of a signature, which is there."""
    sequence_id, _, own = key.partition("-")
    if own:
        asked.store.signature_path(sequence_id, own)
    else:
        asked.store.sequence_record(sequence_id)
    return sequence_id


async def _shown(
    asked: Asked,
    what: Operation,
    key: str,
    media_type: str = "",
    *,
    query: object = None,
    ids: tuple[str, ...] = (),
    also: str = "",
) -> Response:
    """Answer with what an operation makes of a signature; its tag is that of all that it reads."""
    sequence_id = _sequence_of(asked, key)
    facts = asked.store.sequence_record(sequence_id).facts
    own = named = key.partition("-")[2]
    if not own:
        named = asked.state.analysis.resolved(sequence_id, USUAL)[0].key
        with contextlib.suppress(NotFoundError):
            # Where its file is lost it is fitted again, as if it were not stored.
            own = named if asked.store.signature_path(sequence_id, named).is_file() else ""
    kind = media_type or asked.media_type(*what.media_types)
    request = Request(media_type=kind, sequence_id=sequence_id, key=own or None, ids=ids)
    if query is not None:
        request = replace(request, query=query)
    tag = (sequence_id, named, json.dumps(facts_as_json(facts)), also)
    if what is operations.signature_view and kind == JSON and own and asked.wait != 0:
        # It is there as text: two tasks and a thread would take longer than the answer.
        etag = asked.tagged(*tag, request.query.model_dump_json(), kind)
        headers = {"ETag": etag, "Vary": "Accept"}
        if (known := asked.knows(etag)) is not None:
            return known
        if (text := asked.store.rendered_signature(sequence_id, own)) is not None:
            return Response(with_facts(text, facts), 200, headers, JSON)
    return await asked.do(what, request, tag=tag)


async def _known(asked: Asked, key: str, query: queries.ReportRequest) -> KeptClassification | None:
    sequence_id = _sequence_of(asked, key)
    known = models.known_classification
    return await asyncio.to_thread(known, asked.state, sequence_id, query.model)
