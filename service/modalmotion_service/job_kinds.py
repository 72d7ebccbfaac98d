"""What each kind of job does, with the request it was noted with."""

from __future__ import annotations

from typing import Any
from urllib.parse import urlencode

from modalmotion.store import JobState, ResultStore
from modalmotion_service.analysis import Analysis, Upload
from modalmotion_service.jobs import JobRunner, Report
from modalmotion_service.negotiation import HDF5, NPZ, STREAM
from modalmotion_service.routes.tradeoff import TradeoffQuery
from modalmotion_service.schemas import (
    EncodingTarget,
    ManySignatures,
    SignatureQuery,
    UploadQuery,
)
from modalmotion_service.settings import Settings
from modalmotion_service.spool import Spool, SpooledUpload


def make_runner(
    settings: Settings, store: ResultStore, spool: Spool, analysis: Analysis
) -> JobRunner:
    """Make the runner of all kinds of jobs, and clear what no job needs from the spool."""

    async def upload(request: Any, _: Report) -> Any:
        query = UploadQuery(**request["query"])
        options = query.options(settings.read_limits)
        sent = Upload(_spooled(spool, request), options, query.subject, query.label)
        received = await analysis.receive(sent)
        return {"link": f"/v1/sequences/{received.record.id}"}

    async def signature(request: Any, _: Report) -> Any:
        query, sequence_id = SignatureQuery(**request["query"]), request["sequence_id"]
        await analysis.signature(sequence_id, query.parameters())
        chosen = query.model_dump(mode="json", exclude_defaults=True)
        link = f"/v1/sequences/{sequence_id}/signature"
        return {"link": f"{link}?{urlencode(chosen)}" if chosen else link}

    async def signatures(request: Any, report: Report) -> Any:
        asked = ManySignatures(**{n: v for n, v in request.items() if n != "as_hdf5"})
        path = await analysis.pack(asked.ids, asked.parameters(), request["as_hdf5"], report)
        return {"file": path.name, "media_type": HDF5 if request["as_hdf5"] else NPZ}

    async def tradeoff(request: Any, _: Report) -> Any:
        query, media_type = TradeoffQuery(**request["query"]), request["media_type"]
        path = await analysis.tradeoff(
            request["sequence_id"],
            query.parameters(),
            query.front_modes,
            query.components,
            media_type,
        )
        return {"file": path.name, "media_type": media_type}

    async def encoding(request: Any, _: Report) -> Any:
        target = EncodingTarget(**request["target"])
        path, answer = await analysis.encoded(request["sequence_id"], target)
        return {"file": path.name, "media_type": STREAM, "headers": answer.headers}

    async def classification(request: Any, _: Report) -> Any:
        await analysis.classification(request["sequence_id"], request["model"])
        return {"link": f"/v1/sequences/{request['sequence_id']}/classifications"}

    needed = {job.request["file"] for job in store.jobs.unfinished() if job.kind == "upload"}
    done = store.jobs.list(state=JobState.SUCCEEDED, limit=1000).jobs
    needed |= {job.result["file"] for job in done if "file" in job.result}
    spool.clear(keep=needed)
    return JobRunner(
        store,
        {
            "upload": upload,
            "signature": signature,
            "signatures": signatures,
            "encoding": encoding,
            "tradeoff": tradeoff,
            "classification": classification,
        },
        {"upload": lambda request: _spooled(spool, request).remove()},
        n_at_once=2 * settings.workers,
        most_unfinished=settings.max_unfinished_jobs,
    )


def _spooled(spool: Spool, request: Any) -> SpooledUpload:
    return SpooledUpload(spool.at(request["file"]), sha256="", n_bytes=0)
