"""Operations that store what is sent: sequences, templates, images, tracks."""

from __future__ import annotations

import asyncio
import zipfile
from pathlib import Path
from typing import Any, Final

from modalmotion.formats import ReadOptions
from modalmotion_service.http.negotiation import (
    CSV,
    FHIR,
    HDF5,
    JSON,
    NPZ,
    PDF,
    PNG,
    STREAM,
    VIEW,
    ZIP,
    tag_of,
)
from modalmotion_service.http.observation import add_milliseconds, stage
from modalmotion_service.schemas.queries import ImagesView, ModesRequest, TrackView
from modalmotion_service.schemas.requests import (
    SEQUENCE,
    SIGNATURE_OF_FILE,
    TRACK,
    TRADE,
    ClassificationRequest,
    EncodingTarget,
)
from modalmotion_service.schemas.sequences import ImagesSummary, SequenceSummary, TrackAnswer
from modalmotion_service.work.tasks import derived, sequences
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.job_runner import Report
from modalmotion_service.workspace.operation import Outcome, Request, operation
from modalmotion_service.workspace.spool import remove_with_beside
from modalmotion_service.workspace.state import State
from modalmotion_service.workspace.tracks import link_of

# Part of a tracked report that the track is counted as.
_TRACKING: Final = 0.8
_FORMS: Final = {"report.pdf": PDF, "report.fhir.json": FHIR, "frames.csv": CSV}
_PAGE: Final = "view.html"
SAMPLE: Final = "Sample heart (simulated)"
"""Name of the simulated heart."""
# A zip knows no time before.
_NO_DATE: Final = (1980, 1, 1, 0, 0, 0)


def sent(state: State, request: Request) -> Upload:
    """Give the upload of a request, to be read as it states."""
    options = request.query.options(state.settings.read_limits, request.facts)
    return Upload(state.spool.at(request.file or ""), options)


@operation(query=SEQUENCE)
async def upload(state: State, request: Request, report: Report) -> Outcome:
    """Read an upload and store its sequence.

    Of a known sequence, what is stated with it and not known yet is filled in.
    """
    analysis, query, file = state.analysis, request.query, sent(state, request)
    with analysis.image() as image, stage("worker"):
        read, reading, milliseconds = await analysis.followed(report, sequences.ingest, file, image)
        add_milliseconds(milliseconds)
        with stage("store"):
            record, is_new = await asyncio.to_thread(
                state.store.put_sequence_image,
                *(image, read),
                subject=query.subject,
                label=query.label,
            )
    filled: tuple[str, ...] = ()
    if not is_new:
        record, filled = await asyncio.to_thread(
            analysis.completed, record.id, query.subject, query.label, request.facts, read.facts
        )
        if filled:
            reading.notes.append(f"The sequence was known; {', '.join(filled)} is known now too.")
    others = [n for n in read.facts.stated if n in record.facts.changed(read.facts)]
    if others:
        reading.notes.append(
            f"The sequence was known, and keeps its facts; {', '.join(others)} would now "
            "be different. PATCH changes them."
        )
    summary = SequenceSummary.of(record, reading)
    body, here = summary.model_dump_json().encode(), summary.links["self"]
    headers = {"Location": here, "ETag": tag_of(body)}
    return Outcome(body, JSON, 201 if is_new else 200, headers, here, filled)


async def sample(state: State) -> SequenceSummary:
    """Store a simulated heart, for who has none at hand."""
    with state.analysis.image() as image, stage("worker"):
        made = await state.analysis.work(sequences.sample, image)
        record, is_new = await asyncio.to_thread(state.store.put_sequence_image, image, made)
    if is_new:
        record = await asyncio.to_thread(state.store.update_sequence, record.id, name=SAMPLE)
    return SequenceSummary.of(record)


@operation(STREAM, query=EncodingTarget)
async def encoding(state: State, request: Request, report: Report) -> Outcome:
    """Encode a stored sequence."""
    path = await asyncio.to_thread(state.store.sequence_path, request.sequence_id or "")
    return await encoded(state, sequences.encode_kept, path, request.query, report)


async def encoded(
    state: State, task: Any, source: Upload | Path, target: EncodingTarget, report: Report
) -> Outcome:
    """Have a worker encode a sequence."""
    with state.analysis.output() as output, stage("encode"):
        answer = await state.analysis.followed(report, task, source, target, output)
    return Outcome(output, STREAM, headers=answer.headers)


@operation(JSON, PNG, query=TRADE)
async def tradeoff(state: State, request: Request, report: Report) -> Outcome:
    """Measure a trade of modes for accuracy on a stored sequence."""
    analysis, query, sequence_id = state.analysis, request.query, request.sequence_id or ""
    sequence = await asyncio.to_thread(state.store.sequence_path, sequence_id)
    parameters = query.parameters()
    with analysis.output() as output, stage("worker"):
        spent = await analysis.followed(
            *(report, derived.measure_trade, sequence, parameters, query.front_modes, query.only),
            *(analysis.template_path(parameters), request.media_type, output),
            state.store.sequence_record(sequence_id).facts,
        )
        add_milliseconds(spent)
    return Outcome(output, request.media_type)


@operation(query=SIGNATURE_OF_FILE)
async def template(state: State, request: Request, report: Report) -> Outcome:
    """Make and store the template of an upload."""
    analysis, parameters = state.analysis, request.query.parameters()
    with analysis.image() as image, stage("worker"):
        answer, milliseconds = await analysis.followed(
            report, sequences.make_template, sent(state, request), parameters, image
        )
        add_milliseconds(milliseconds)
        with stage("store"):
            is_new = await asyncio.to_thread(state.store.put_template_image, image, answer.id)
    headers = {"Location": answer.links["self"], "ETag": tag_of(answer.id, JSON)}
    body = answer.model_dump_json().encode()
    return Outcome(body, JSON, 201 if is_new else 200, headers, answer.links["self"])


@operation(JSON, PNG)
async def template_view(state: State, request: Request, _: Report) -> Outcome:
    """Describe or draw a stored template."""
    path = await asyncio.to_thread(state.store.template_path, request.reference)
    if request.media_type == PNG:
        return Outcome(await state.analysis.work(sequences.draw_template, path), PNG)
    answer = await state.analysis.work(sequences.describe_template, path)
    return Outcome(answer.model_dump_json().encode())


@operation(JSON, NPZ, HDF5, PNG, query=ModesRequest)
async def template_modes(state: State, request: Request, _: Report) -> Outcome:
    """Give the vibration modes of a stored template."""
    path = await asyncio.to_thread(state.store.template_path, request.reference)
    with stage("modes"):
        body = await state.analysis.work(
            sequences.modes_of_template, path, request.query, request.media_type
        )
    return Outcome(body, request.media_type)


@operation()
async def images(state: State, request: Request, report: Report) -> Outcome:
    """Read images and store them."""
    limits = ReadOptions(limits=state.settings.image_limits)
    read = Upload(state.spool.at(request.file or ""), limits)
    record, is_new = await state.images.take(read, report)
    here = link_of(record.id)
    body = ImagesSummary.of(record).model_dump_json().encode()
    return Outcome(body, JSON, 201 if is_new else 200, {"Location": here}, here)


@operation(VIEW, query=ImagesView)
async def slices(state: State, request: Request, _: Report) -> Outcome:
    """Give the slices of one frame of images, and a track's surface in it."""
    query = request.query
    return Outcome(await state.images.slices(request.ids[0], query.frame, query.track), VIEW)


async def settle(state: State, request: Request, link: str) -> None:
    """Keep the images of a track for its pictures, or delete them."""
    track_id = link.rpartition("/")[2]
    await state.tracks.settle(request.query.images, track_id, is_kept=request.query.keep)


@operation(query=TRACK, settle=settle)
async def track(state: State, request: Request, report: Report) -> Outcome:
    """Track a surface through an upload or stored images, and store what is found."""
    query = request.query
    made = await state.tracks.keep(
        query.images or _recording(state, request),
        query.parameters(request.facts),
        query.start,
        subject=query.subject,
        label=query.label,
        report=report,
    )
    answer = TrackAnswer.joined(made.estimate, made.record, query.images if query.keep else None)
    here = answer.links["self"]
    status, headers = 201 if made.is_new else 200, {"Location": here}
    body = answer.model_dump_json().encode()
    return Outcome(body, JSON, status, headers, here, made.filled)


def _recording(state: State, request: Request) -> Upload:
    limits = ReadOptions(limits=state.settings.read_limits)
    return Upload(state.spool.at(request.file or ""), limits)


@operation(JSON, HDF5, PNG, VIEW, query=TrackView)
async def track_view(state: State, request: Request, _: Report) -> Outcome:
    """Describe or draw a stored track, or give its file or its data."""
    track_id, media_type = request.sequence_id or "", request.media_type
    if media_type == PNG:
        return Outcome(await state.tracks.draw(track_id, request.query), PNG)
    give = {HDF5: state.tracks.as_hdf5, VIEW: state.tracks.data}.get(media_type)
    if give is not None:
        return Outcome(await give(track_id), media_type)
    answer = await state.tracks.describe(track_id)
    return Outcome(answer.model_dump_json().encode())


@operation(ZIP, query=TRACK, settle=settle)
async def tracked_report(state: State, request: Request, report: Report) -> Outcome:
    """Track a surface, name the class of its motion, and write each form of a report to a zip."""
    made = await track.work(state, request, lambda share, text="": report(_TRACKING * share, text))
    track_id = (made.link or "").rpartition("/")[2]
    report(_TRACKING, "report")
    path = await _whole_report(state, track_id, request.query.model)
    name = f'attachment; filename="{track_id[:12]}-report.zip"'
    # The job ends with the track that its link names, and with it the file.
    return Outcome(path, ZIP, 200, {"Content-Disposition": name}, made.link, made.filled)


async def _whole_report(state: State, sequence_id: str, model: str | None) -> Path:
    known = None
    if model is not None:
        chosen = await asyncio.to_thread(state.models.choose_for, model, sequence_id)
        coverage = ClassificationRequest().coverage
        known, _ = await state.models.classification(sequence_id, chosen, coverage)
    kept = None if known is None else known.path
    analysis, output, page = state.analysis, state.spool.new_path(), state.spool.new_path()
    try:
        async with analysis.fitted(sequence_id, None) as one:
            forms = {
                name: await analysis.work(derived.make_report, one, media_type, kept)
                for name, media_type in _FORMS.items()
            }
            await analysis.work(derived.make_view, one, True, page)
        await asyncio.to_thread(_zip, output, forms, page)
    except BaseException:
        remove_with_beside(output)
        raise
    finally:
        remove_with_beside(page)
    return output


def _zip(output: Path, forms: dict[str, bytes], page: Path) -> None:
    with zipfile.ZipFile(output, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in (*forms.items(), (_PAGE, page.read_bytes())):
            archive.writestr(
                zipfile.ZipInfo(name, _NO_DATE), data, compress_type=zipfile.ZIP_DEFLATED
            )
