"""Operations on signatures: made, shown, and all that follows from one or from many."""

import asyncio
from dataclasses import asdict, replace
from typing import Final

from modalmotion.exports.signature_pack import SurfaceFormat
from modalmotion.modes.topologies import MESH
from modalmotion.progress import Reporter, part_of, silent
from modalmotion_service.http import negotiation
from modalmotion_service.http import negotiation as media
from modalmotion_service.schemas import queries, requests
from modalmotion_service.schemas.results import ClassificationAnswer
from modalmotion_service.schemas.signatures import DistanceAnswer
from modalmotion_service.work.tasks import signatures
from modalmotion_service.workspace import models
from modalmotion_service.workspace.analysis import USUAL, with_facts
from modalmotion_service.workspace.operation import (
    Outcome,
    Request,
    State,
    as_json,
    made,
    operation,
)

SIGNATURE_TYPES: Final = (media.JSON, media.HDF5, media.NPZ, media.RAW, media.PNG, media.CSV)
"""RAW is its amplitudes as little-endian float32, CSV a row for each of them."""

SURFACES: Final = {
    media.NPZ: (SurfaceFormat.NPZ, ".npz"),
    media.VTKHDF: (SurfaceFormat.VTKHDF, ".vtkhdf"),
    media.GLB: (SurfaceFormat.GLB, ".glb"),
    media.ZIP: (SurfaceFormat.PLY, ".zip"),
}
"""Formats of surfaces, by media type."""


@operation(*SIGNATURE_TYPES, query=requests.SIGNATURE)
async def signature(state: State, request: Request, report: Reporter) -> Outcome:
    """Fit a signature to a stored sequence and store it, and give it."""
    analysis, sequence_id = state.analysis, request.sequence_id
    parameters, _ = analysis.resolved(sequence_id, request.query.parameters())
    known = await asyncio.to_thread(state.store.sound_signature_path, sequence_id, parameters.key)
    await analysis.signature(sequence_id, parameters, report)
    here = f"/v1/signatures/{sequence_id}-{parameters.key}"
    body = await shown(state, sequence_id, parameters.key, request.media_type)
    status = 200 if known is not None else 201
    return Outcome(body, request.media_type, status, {"Location": here}, here)


@operation(*SIGNATURE_TYPES)
async def signature_view(state: State, request: Request, report: Reporter) -> Outcome:
    """Give a stored signature, or the usual one of a sequence."""
    body = await shown(state, request.sequence_id, request.key, request.media_type, report)
    headers = negotiation.attachment(f"{request.sequence_id[:12]}-signature.h5")
    return Outcome(
        body, request.media_type, headers=headers if request.media_type == media.HDF5 else {}
    )


async def shown(
    state: State,
    sequence_id: str,
    key: str | None,
    media_type: str,
    report: Reporter = silent,
) -> bytes:
    """Give a signature as a media type."""
    analysis = state.analysis
    if media_type == media.JSON and key is not None:
        text = await analysis.rendered(sequence_id, key)
        return with_facts(text, state.store.sequence_record(sequence_id).facts)
    async with analysis.fitted(sequence_id, key, report) as one:
        if media_type == media.JSON:
            return with_facts(
                await analysis.work(signatures.render, one.signature, None, None), one.facts
            )
        return await analysis.work(signatures.signature_as, one, media_type)


@operation(media.JSON, media.PNG, media.CSV)
async def readouts(state: State, request: Request, report: Reporter) -> Outcome:
    """Read volumes, rates and strain from a signature."""
    return await _read_out(state, request, report, request.media_type)


@operation(media.JSON)
async def strain(state: State, request: Request, report: Reporter) -> Outcome:
    """Read the strain of the wall from a signature."""
    return await _read_out(state, request, report, signatures.STRAIN)


async def _read_out(state: State, request: Request, report: Reporter, how: str) -> Outcome:
    async with state.analysis.fitted(request.sequence_id, request.key, report) as one:
        body = await state.analysis.work(signatures.read_out, one, how)
    return Outcome(body, request.media_type)


@operation(*SURFACES, query=queries.Reconstruction)
async def reconstruction(state: State, request: Request, report: Reporter) -> Outcome:
    """Superpose a signature's surfaces."""
    surface_format, suffix = SURFACES[request.media_type]
    times, phases = request.query.instants()
    async with state.analysis.fitted(request.sequence_id, request.key, report) as one:
        output = await state.analysis.written(
            *(signatures.superpose, one, surface_format),
            *(times, phases, request.query.max_targets),
        )
    headers = negotiation.attachment(f"{one.record.id[:12]}-reconstruction{suffix}")
    return Outcome(output, request.media_type, headers=headers)


@operation(media.FHIR, media.PDF, media.CSV, query=queries.ReportRequest)
async def report(state: State, request: Request, tell: Reporter) -> Outcome:
    """Report on a signature, for systems, people or statistics."""
    known = await asyncio.to_thread(
        models.known_classification, state, request.sequence_id, request.query.model
    )
    async with state.analysis.fitted(request.sequence_id, request.key, tell) as one:
        classified = None if known is None else known.path
        body = await state.analysis.work(
            signatures.make_report, one, request.media_type, classified
        )
    kind = request.media_type
    return Outcome(body, f"{kind}; fhirVersion=4.0" if kind == media.FHIR else kind)


@operation(media.VIEW, media.HTML, query=queries.ViewRequest)
async def view(state: State, request: Request, report: Reporter) -> Outcome:
    """Write what a page shows of a signature, or its frames as they were sent."""
    query, as_page = request.query, request.media_type == media.HTML
    async with state.analysis.fitted(request.sequence_id, request.key, report) as one:
        if query.first is None and query.stop is None:
            output = await state.analysis.written(signatures.make_view, one, as_page)
        else:
            output = await state.analysis.written(
                signatures.make_frames, one, query.first or 0, query.stop
            )
    headers = negotiation.attachment(f"{one.record.id[:12]}.html") if as_page else {}
    return Outcome(output, request.media_type, headers=headers)


@operation(query=queries.DistanceRequest)
async def distance(state: State, request: Request, report: Reporter) -> Outcome:
    """Compare two signatures."""
    other_id, _, other_key = request.query.to.partition("-")
    analysis, is_usual = state.analysis, request.key is None and not other_key
    for usual in (USUAL, replace(USUAL, topology=MESH)):
        async with (
            analysis.fitted(request.sequence_id, request.key, report, usual) as own,
            analysis.fitted(other_id, other_key or None, report, usual) as other,
        ):
            if is_usual and usual.closed_form:
                kinds = await analysis.work(signatures.kinds_of, [own.signature, other.signature])
                if len({bool(mesh) for _, mesh in kinds}) > 1:
                    # Of two closed surfaces one has the springs of its mesh: then both have.
                    continue
            found = await analysis.work(
                signatures.compare_signatures, own, other, request.query.closed
            )
            break
    return as_json(DistanceAnswer(**asdict(found)))


def classification_answer(state: State, kept: models.KeptClassification) -> ClassificationAnswer:
    """Write a stored classification out."""
    file = kept.path.relative_to(state.store.root).as_posix()
    return ClassificationAnswer.of(kept.result, kept.version, file)


@operation(query=requests.ClassificationRequest)
async def classification(state: State, request: Request, report: Reporter) -> Outcome:
    """Ask a model for the class of a stored sequence's motion, and store the answer."""
    query, sequence_id = request.query, request.sequence_id
    model = await asyncio.to_thread(models.choose, state, request.reference)
    kept, is_new = await models.classification(state, sequence_id, model, query.coverage, report)
    here = f"/v1/signatures/{sequence_id}/classifications"
    # A link would lead a job to the answers of all models.
    return replace(made(classification_answer(state, kept), here, is_new), link=None)


@operation(media.NPZ, media.HDF5, media.CSV, query=requests.MANY_SIGNATURES)
async def signatures_query(state: State, request: Request, report: Reporter) -> Outcome:
    """Pack the signatures of many sequences into one file, or a table."""
    analysis, ids = state.analysis, list(request.ids)
    parameters = request.query.parameters()

    paths = await analysis.each(
        *(ids, lambda one: analysis.signature(one, parameters)),
        *(part_of(report, 0.0, len(ids) / (len(ids) + 1)), "signature"),
    )
    records = [state.store.sequence_record(sequence_id) for sequence_id in ids]
    paths = await analysis.of_one_kind(ids, parameters, paths)
    if request.media_type == media.CSV:
        kept = [state.store.sequence_path(r.id) if r.has_upload else None for r in records]
        template = analysis.template_path(parameters)
        output = await analysis.written(signatures.tabulate, paths, records, kept, template)
    else:
        task = signatures.pack_hdf5 if request.media_type == media.HDF5 else signatures.pack_npz
        output = await analysis.written(task, paths, records)
    suffix = {media.HDF5: "h5", media.NPZ: "npz", media.CSV: "csv"}[request.media_type]
    headers = negotiation.attachment(f"signatures.{suffix}")
    return Outcome(output, request.media_type, headers=headers)
