"""Handlers of all kinds of jobs, each a function of the job's request."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlencode

from modalmotion.classification import TrainingOptions
from modalmotion.errors import LostFileError
from modalmotion.facts import Facts, facts_from_json
from modalmotion.formats import ReadOptions
from modalmotion_service.http.negotiation import ZIP
from modalmotion_service.schemas import (
    ManySignatures,
    SignatureQuery,
    UploadQuery,
)
from modalmotion_service.schemas.request_queries import TemplateQuery
from modalmotion_service.schemas.tracks import TrackedReportQuery, TrackQuery
from modalmotion_service.settings import Settings
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.disk import require_room
from modalmotion_service.workspace.images import Images, link_of
from modalmotion_service.workspace.job_runner import Handler, JobRunner, Report
from modalmotion_service.workspace.jobs import Jobs
from modalmotion_service.workspace.models import Models
from modalmotion_service.workspace.norms import Norms
from modalmotion_service.workspace.replies import Replies
from modalmotion_service.workspace.reply_kinds import OF_UPLOADS
from modalmotion_service.workspace.spool import Spool
from modalmotion_service.workspace.tracks import Tracks
from modalmotion_service.workspace.training import Trainer
from modalmotion_service.workspace.training_set import cases_from_json, read_cases
from modalmotion_service.workspace.whole_report import whole_report

# Kinds of jobs whose request names a file in the spool, kept until the job is finished.
_WITH_FILES: Final = ("upload", "template", "images", "track", "tracked-report", "training")

# Part of a tracked report that the track is counted as.
_TRACKING: Final = 0.8


def trainings_at_once(settings: Settings) -> int:
    """Give how many models train at a time; each may take all of a processor for long."""
    return max(1, settings.workers // 2)


def make_runner(
    settings: Settings,
    jobs: Jobs,
    spool: Spool,
    analysis: Analysis,
    models: Models,
    images: Images,
    tracks: Tracks,
    norms: Norms,
    trainer: Trainer,
    replies: Replies,
) -> JobRunner:
    """Make the runner of all kinds of jobs."""

    async def upload(request: Any, report: Report) -> Any:
        query = UploadQuery(**request["query"])
        facts = facts_from_json(request["facts"])
        sent = Upload(_spooled(spool, request), query.options(settings.read_limits, facts))
        result = await analysis.keep(sent, subject=query.subject, label=query.label, report=report)
        return {"link": f"/v1/sequences/{result.record.id}"}

    async def signature(request: Any, report: Report) -> Any:
        query, sequence_id = SignatureQuery(**request["query"]), request["sequence_id"]
        await analysis.signature(sequence_id, query.parameters(), report)
        parameters = query.model_dump(mode="json", exclude_defaults=True)
        link = f"/v1/sequences/{sequence_id}/signature"
        return {"link": f"{link}?{urlencode(parameters)}" if parameters else link}

    async def signatures(request: Any, report: Report) -> Any:
        query = ManySignatures(**{n: v for n, v in request.items() if n != "media_type"})
        path = await analysis.pack(query.ids, query.parameters(), request["media_type"], report)
        return {"file": path.name, "media_type": request["media_type"]}

    async def template(request: Any, report: Report) -> Any:
        query = TemplateQuery(**request["query"])
        facts = facts_from_json(request["facts"])
        sent = Upload(_spooled(spool, request), query.options(settings.read_limits, facts))
        answer, _is_new = await analysis.template(sent, query.parameters(), report)
        return {"link": answer.links["self"]}

    async def image(request: Any, report: Report) -> Any:
        sent = Upload(_spooled(spool, request), ReadOptions(limits=settings.image_limits))
        record, _is_new = await images.take(sent, report)
        return {"link": link_of(record.id)}

    async def tracked(request: Any, query: TrackQuery, report: Report) -> str:
        parameters = query.parameters(facts_from_json(request["facts"]))
        sent: Upload | str
        if query.images is None:
            sent = Upload(_spooled(spool, request), ReadOptions(limits=settings.read_limits))
        else:
            sent = query.images
        result = await tracks.keep(
            sent,
            parameters,
            query.start,
            subject=query.subject,
            label=query.label,
            report=report,
        )
        return result.record.id

    async def track(request: Any, report: Report) -> Any:
        track_id = await tracked(request, TrackQuery(**request["query"]), report)
        return {"link": f"/v1/tracks/{track_id}"}

    async def tracked_report(request: Any, report: Report) -> Any:
        query = TrackedReportQuery(**request["query"])

        def tell(share: float, text: str = "") -> None:
            report(_TRACKING * share, text)

        track_id = await tracked(request, query, tell)
        report(_TRACKING, "report")
        path = await whole_report(track_id, query.model, analysis, models, spool)
        name = f'attachment; filename="{track_id[:12]}-report.zip"'
        # The job ends with the track that its link names, and with it the file.
        return {
            "file": path.name,
            "media_type": ZIP,
            "headers": {"Content-Disposition": name},
            "link": f"/v1/tracks/{track_id}",
        }

    async def settle(request: Any, result: Any) -> None:
        query = TrackQuery.model_construct(**request["query"])
        track_id = result["link"].rpartition("/")[2]
        await tracks.settle(query.images, track_id, is_kept=query.keep)

    def reply(kind: str) -> Handler:
        async def handler(request: Any, report: Report) -> Any:
            if "file" in request:
                _spooled(spool, request)
            return await replies.as_job(kind, request, report)

        return handler

    async def classification(request: Any, report: Report) -> Any:
        model = await asyncio.to_thread(models.choose, request["model"])
        # Jobs of an earlier version state none.
        stated = Facts(covariates=request.get("covariates", {}))
        await models.classification(
            request["sequence_id"], model, request["coverage"], stated, report
        )
        return {"link": f"/v1/sequences/{request['sequence_id']}/classifications"}

    async def training(request: Any, report: Report) -> Any:
        cases = await asyncio.to_thread(read_cases, _spooled(spool, request))
        options = TrainingOptions.from_json(request["options"])
        record = await trainer.train(request["file"], request["name"], options, cases, report)
        return {"link": f"/v1/models/{record.name}/versions/{record.version}"}

    def remove_file(request: Any) -> None:
        # A track of stored images has none.
        if "file" in request:
            spool.remove(request["file"])

    async def norm(request: Any, report: Report) -> Any:
        cases = cases_from_json(request["cases"])
        made = await norms.make(
            request["name"], cases, request["modes"], request["topology"], report
        )
        return {"link": f"/v1/norms/{made.name}"}

    return JobRunner(
        jobs,
        {
            "upload": upload,
            "signature": signature,
            "signatures": signatures,
            "template": template,
            "images": image,
            "track": track,
            "tracked-report": tracked_report,
            "classification": classification,
            "training": training,
            "norm": norm,
            **{kind: reply(kind) for kind in replies.kinds},
        },
        dict.fromkeys((*_WITH_FILES, *OF_UPLOADS), remove_file),
        n_at_once=2 * analysis.engine.n_workers,
        most_unfinished=settings.max_unfinished_jobs,
        apart={"training": trainings_at_once(settings)},
        settle={"track": settle, "tracked-report": settle},
        require_store=lambda: require_room(spool.folder),
        retry_seconds=3600.0 * settings.retry_hours,
    )


def _spooled(spool: Spool, request: Any) -> Path:
    """Find the file that came with a job.

    Raises
    ------
    LostFileError
        If it is gone.
    """
    path = spool.at(request["file"])
    if not path.is_file():
        raise LostFileError(
            "The file that came with this job is lost: it was stored until the job's end.",
            remedy="Send the request again; and look after the disk of the data folder.",
        )
    return path
