"""Makers of all kinds of answers that nobody keeps."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import BaseModel

from modalmotion.exports.surfaces import SurfaceFormat
from modalmotion.facts import Facts, facts_from_json
from modalmotion_service.http.negotiation import (
    CSV,
    FHIR,
    GLB,
    HDF5,
    HTML,
    JSON,
    NPZ,
    PNG,
    STREAM,
    VIEW,
    VTKHDF,
    ZIP,
)
from modalmotion_service.schemas import (
    ClassificationAnswer,
    DistanceAnswer,
    EncodingTarget,
    ModesQuery,
    ReadingQuery,
    SignatureQuery,
    UploadClassificationAnswer,
    parse_times,
)
from modalmotion_service.schemas.norms import DeviationQuery
from modalmotion_service.schemas.request_queries import (
    ClassifyQuery,
    DecodeQuery,
    DistanceQuery,
    EncodeQuery,
    ReconstructionQuery,
    ReportQuery,
    TemplateQuery,
    ViewFramesQuery,
)
from modalmotion_service.schemas.tracks import TrackViewQuery
from modalmotion_service.schemas.tradeoff_query import TradeoffQuery
from modalmotion_service.settings import Settings
from modalmotion_service.work.upload import Upload, parts_from_json
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.batches import Batches
from modalmotion_service.workspace.evaluations import Evaluations
from modalmotion_service.workspace.feature_tables import FeatureTables
from modalmotion_service.workspace.images import Images
from modalmotion_service.workspace.job_runner import Report
from modalmotion_service.workspace.models import Models
from modalmotion_service.workspace.norms import Norms
from modalmotion_service.workspace.replies import Maker, Replies, Reply, Request
from modalmotion_service.workspace.spool import Spool
from modalmotion_service.workspace.tracks import Tracks
from modalmotion_service.workspace.training_set import cases_from_json

Query = TypeVar("Query", bound=BaseModel)

SURFACES: Final = {
    NPZ: (SurfaceFormat.NPZ, ".npz"),
    VTKHDF: (SurfaceFormat.VTKHDF, ".vtkhdf"),
    GLB: (SurfaceFormat.GLB, ".glb"),
    ZIP: (SurfaceFormat.PLY, ".zip"),
}
"""Formats of surfaces, by media type."""

OF_UPLOADS: Final = (
    *("sent-signature", "sent-signatures", "sent-classification", "sent-classifications"),
    *("sent-encoding", "decoding"),
)
"""Kinds whose request names a file in the spool."""


def query_of(request: Request, model: type[Query], name: str = "query") -> Query:
    """Give the query of a request, be it the client's own or one that a job remembers."""
    query = request[name]
    return query if isinstance(query, model) else model(**query)


def make_replies(
    settings: Settings,
    spool: Spool,
    analysis: Analysis,
    models: Models,
    images: Images,
    tracks: Tracks,
    norms: Norms,
    evaluations: Evaluations,
) -> Replies:
    """Make the maker of all kinds."""
    tables = FeatureTables(analysis, spool)
    many = Batches(settings, analysis, models, spool)

    def sent(request: Request, query: ReadingQuery) -> Upload:
        facts = request["facts"]
        stated = facts if isinstance(facts, Facts) else facts_from_json(facts)
        return Upload(spool.at(request["file"]), query.options(settings.read_limits, stated))

    async def sent_signature(request: Request, _: Report) -> Reply:
        query, media_type = query_of(request, TemplateQuery), request["media_type"]
        upload = sent(request, query)
        body = await analysis.signature_of_upload(upload, query.parameters(), media_type)
        return Reply(body, media_type)

    async def sent_classification(request: Request, _: Report) -> Reply:
        query = query_of(request, ClassifyQuery)
        model = await asyncio.to_thread(models.choose, query.model)
        result, reading = await models.classify(sent(request, query), model, query.coverage)
        named = ClassificationAnswer.of(result, model.version, None).model_dump()
        answer = UploadClassificationAnswer(**named, reading=reading)
        return Reply(answer.model_dump_json().encode(), JSON)

    async def sent_signatures(request: Request, report: Report) -> Reply:
        query, media_type = query_of(request, TemplateQuery), request["media_type"]
        path, parts = spool.at(request["file"]), parts_from_json(request["parts"])
        return await many.signatures(path, parts, query, media_type, report)

    async def sent_classifications(request: Request, report: Report) -> Reply:
        query, media_type = query_of(request, ClassifyQuery), request["media_type"]
        model = await asyncio.to_thread(models.choose, query.model)
        path, parts = spool.at(request["file"]), parts_from_json(request["parts"])
        return await many.classifications(path, parts, query, model, media_type, report)

    async def sent_encoding(request: Request, report: Report) -> Reply:
        query = query_of(request, EncodeQuery)
        target = EncodingTarget(**query.model_dump(include=set(EncodingTarget.model_fields)))
        path, answer = await analysis.encoded(sent(request, query), target, report)
        return Reply(path, STREAM, answer.headers)

    async def decoding(request: Request, _: Report) -> Reply:
        query, media_type = query_of(request, DecodeQuery), request["media_type"]
        frames = None
        if query.first is not None and query.stop is not None:
            frames = range(query.first, query.stop)
        vertices = None
        if query.first_vertex is not None and query.stop_vertex is not None:
            vertices = range(query.first_vertex, query.stop_vertex)
        stream, limits = spool.at(request["file"]), settings.read_limits
        path = await analysis.decoded(stream, limits, frames, vertices, media_type)
        return Reply(path, media_type)

    async def encoding(request: Request, report: Report) -> Reply:
        target = query_of(request, EncodingTarget, "target")
        path, answer = await analysis.encoded(request["sequence_id"], target, report)
        return Reply(path, STREAM, answer.headers)

    async def tradeoff(request: Request, report: Report) -> Reply:
        query, media_type = query_of(request, TradeoffQuery), request["media_type"]
        path = await analysis.tradeoff(
            request["sequence_id"],
            query.parameters(),
            query.front_modes,
            query.components,
            media_type,
            report,
        )
        return Reply(path, media_type)

    async def signature_view(request: Request, _: Report) -> Reply:
        parameters = query_of(request, SignatureQuery).parameters()
        sequence_id, media_type = request["sequence_id"], request["media_type"]
        # The landmarks are those that the facts state now.
        resolved, _facts = analysis.resolved(sequence_id, parameters)
        give = {
            HDF5: analysis.signature_hdf5,
            JSON: analysis.signature_json,
            PNG: analysis.draw_signature,
        }.get(media_type, partial(analysis.signature_as, media_type=media_type))
        return Reply(await give(sequence_id, resolved), media_type)

    async def distance(request: Request, _: Report) -> Reply:
        query = query_of(request, DistanceQuery)
        own, other = request["ids"]
        found = await analysis.distance(own, other, query.parameters(), query.closed)
        answer = DistanceAnswer(**asdict(found))
        return Reply(answer.model_dump_json().encode(), JSON)

    async def readouts(request: Request, _: Report) -> Reply:
        query, media_type = query_of(request, SignatureQuery), request["media_type"]
        parameters, _facts = analysis.resolved(request["sequence_id"], query.parameters())
        body = await analysis.readouts(request["sequence_id"], parameters, media_type)
        return Reply(body, media_type)

    async def report(request: Request, _: Report) -> Reply:
        query, media_type = query_of(request, ReportQuery), request["media_type"]
        sequence_id = request["sequence_id"]
        parameters, _facts = analysis.resolved(sequence_id, query.parameters())
        known = None
        if query.model is not None:
            known = await asyncio.to_thread(models.known_classification, sequence_id, query.model)
        path = None if known is None else known.path
        body = await analysis.report(sequence_id, parameters, path, media_type)
        kind = f"{media_type}; fhirVersion=4.0" if media_type == FHIR else media_type
        return Reply(body, kind)

    async def reconstruction(request: Request, _: Report) -> Reply:
        query, media_type = query_of(request, ReconstructionQuery), request["media_type"]
        surface_format, suffix = SURFACES[media_type]
        path: Path = await analysis.reconstruction(
            request["sequence_id"],
            query.parameters(),
            surface_format,
            None if query.times is None else parse_times(query.times),
            query.frames if query.phases is None else parse_times(query.phases),
            query.max_targets,
        )
        name = f"{request['sequence_id'][:12]}-reconstruction{suffix}"
        return Reply(path, media_type, {"Content-Disposition": f'attachment; filename="{name}"'})

    async def view(request: Request, _: Report) -> Reply:
        query, media_type = query_of(request, SignatureQuery), request["media_type"]
        sequence_id = request["sequence_id"]
        parameters, _facts = analysis.resolved(sequence_id, query.parameters())
        path = await analysis.view(sequence_id, parameters, as_page=media_type == HTML)
        name = f"{sequence_id[:12]}.html"
        page = {"Content-Disposition": f'attachment; filename="{name}"'}
        return Reply(path, media_type, page if media_type == HTML else {})

    async def view_frames(request: Request, _: Report) -> Reply:
        query, sequence_id = query_of(request, ViewFramesQuery), request["sequence_id"]
        parameters, _facts = analysis.resolved(sequence_id, query.parameters())
        path = await analysis.view_frames(sequence_id, parameters, query.first, query.stop)
        return Reply(path, VIEW)

    async def slices(request: Request, _: Report) -> Reply:
        images_id, *named = request["ids"]
        body = await images.slices(images_id, request["frame"], named[0] if named else None)
        return Reply(body, VIEW)

    async def template_modes(request: Request, _: Report) -> Reply:
        query, media_type = query_of(request, ModesQuery), request["media_type"]
        body = await analysis.template_modes(request["template_id"], query, media_type)
        return Reply(body, media_type)

    async def template_view(request: Request, _: Report) -> Reply:
        template_id, media_type = request["template_id"], request["media_type"]
        if media_type == PNG:
            return Reply(await analysis.draw_template(template_id), media_type)
        answer = await analysis.describe_template(template_id)
        return Reply(answer.model_dump_json().encode(), media_type)

    async def track_view(request: Request, _: Report) -> Reply:
        track_id, media_type = request["sequence_id"], request["media_type"]
        if media_type == PNG:
            query = query_of(request, TrackViewQuery)
            return Reply(await tracks.draw(track_id, query), media_type)
        give = {HDF5: tracks.as_hdf5, VIEW: tracks.data}.get(media_type)
        if give is not None:
            return Reply(await give(track_id), media_type)
        answer = await tracks.describe(track_id)
        return Reply(answer.model_dump_json().encode(), media_type)

    async def evaluation(request: Request, report: Report) -> Reply:
        model = await asyncio.to_thread(models.choose, request["model"])
        cases = cases_from_json(request["cases"])
        media_type = request["media_type"]
        body = await evaluations.evaluate(model, cases, request["coverage"], media_type, report)
        return Reply(body, media_type)

    async def comparison(request: Request, report: Report) -> Reply:
        first, second = [await asyncio.to_thread(models.choose, name) for name in request["models"]]
        cases = cases_from_json(request["cases"])
        body = await evaluations.compare((first, second), cases, request["coverage"], report)
        return Reply(body, JSON)

    async def deviation(request: Request, _: Report) -> Reply:
        query = query_of(request, DeviationQuery)
        return Reply(await norms.deviation(request["sequence_id"], query.norm, query.level), JSON)

    async def cohort_deviation(request: Request, report: Report) -> Reply:
        cases = cases_from_json(request["cases"])
        body = await norms.together(cases, request["norm"], request["level"], report)
        return Reply(body, JSON)

    async def held_out(request: Request, _: Report) -> Reply:
        model = await asyncio.to_thread(models.choose, request["model"])
        name = f"{model.name}-{model.version}.csv"
        disposition = {"Content-Disposition": f'attachment; filename="{name}"'}
        return Reply(await evaluations.held_out_table(model), CSV, disposition)

    async def model_view(request: Request, _: Report) -> Reply:
        model = await asyncio.to_thread(models.choose, request["model"])
        content = await asyncio.to_thread(models.describe, model)
        return Reply(await models.draw(content), PNG)

    async def features(request: Request, report: Report) -> Reply:
        media_type = request["media_type"]
        path, n_left_out = await tables.make(
            cases_from_json(request["cases"]),
            request["options"],
            media_type,
            report,
            leaves_out=request["on_error"] == "leave out",
        )
        return Reply(path, media_type, {"Cases-Left-Out": str(n_left_out)})

    makers: dict[str, Maker] = {
        "features": features,
        "sent-signature": sent_signature,
        "sent-signatures": sent_signatures,
        "sent-classification": sent_classification,
        "sent-classifications": sent_classifications,
        "sent-encoding": sent_encoding,
        "decoding": decoding,
        "encoding": encoding,
        "tradeoff": tradeoff,
        "signature-view": signature_view,
        "distance": distance,
        "readouts": readouts,
        "report": report,
        "reconstruction": reconstruction,
        "view": view,
        "view-frames": view_frames,
        "slices": slices,
        "template-modes": template_modes,
        "template-view": template_view,
        "model-view": model_view,
        "track-view": track_view,
        "evaluation": evaluation,
        "comparison": comparison,
        "deviation": deviation,
        "cohort-deviation": cohort_deviation,
        "held-out": held_out,
    }
    return Replies(makers, spool)


def as_json(request: Request) -> dict[str, Any]:
    """Write a request as a job remembers it."""
    from modalmotion.facts import facts_as_json

    def plain(value: Any) -> Any:
        if isinstance(value, BaseModel):
            return value.model_dump(mode="json")
        return facts_as_json(value) if isinstance(value, Facts) else value

    return {name: plain(value) for name, value in request.items()}
