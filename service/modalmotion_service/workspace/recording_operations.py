"""Sequences, templates, images and tracks: stored, shown, replaced, deleted with all mentions."""

import asyncio
import contextlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any, Final

from modalmotion.errors import NotFoundError
from modalmotion.notes import Note
from modalmotion.progress import Progress, Reporter, part_of
from modalmotion.store import SequenceRecord, index
from modalmotion_service.errors import ConflictError
from modalmotion_service.http import negotiation as media
from modalmotion_service.http.negotiation import attachment, tag_of
from modalmotion_service.schemas import queries, requests
from modalmotion_service.schemas.sequences import ImagesSummary, SequenceSummary, TrackAnswer
from modalmotion_service.work.tasks import sequences, signatures, tracks
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace import models, spool
from modalmotion_service.workspace.jobs import Job, gone, results_of
from modalmotion_service.workspace.operation import Outcome, Request, State, made, operation

SAMPLE: Final = "Sample heart (simulated)"
"""Name of the simulated heart."""


def sent(state: State, request: Request) -> Upload:
    """Give the upload of a request, to be read as it states."""
    options = request.query.options(state.settings.read_limits, request.facts)
    return Upload(state.spool.at(request.file), options)


@operation(query=requests.SEQUENCE)
async def upload(state: State, request: Request, report: Reporter) -> Outcome:
    """Read an upload and store its sequence.

    Of a known sequence, what is stated with it and not known yet is filled in.
    """
    analysis, file = state.analysis, sent(state, request)
    subject, label = request.query.subject, request.query.label
    with analysis.image() as image:
        read, reading = await analysis.followed(report, sequences.ingest, file, image)
        record, is_new = await analysis.stored(
            state.store.put_sequence_image, image, read, subject=subject, label=label
        )
    filled: tuple[str, ...] = ()
    if not is_new:
        record, filled = await asyncio.to_thread(
            analysis.completed, record.id, subject, label, request.facts, read.facts
        )
        if filled:
            reading.notes.append(Note.of("facts_filled", facts=", ".join(filled)))
    others = [n for n in read.facts.stated if n in record.facts.changed(read.facts)]
    if others:
        reading.notes.append(Note.of("facts_kept", facts=", ".join(others)))
    summary = SequenceSummary.of(record, reading)
    tag = tag_of(summary.model_dump_json())
    return made(summary, summary.links["self"], is_new, filled=filled, headers={"ETag": tag})


async def sample(state: State) -> SequenceSummary:
    """Store a simulated heart, for who has none at hand."""
    with state.analysis.image() as image:
        simulated = await state.analysis.work(sequences.sample, image)
        record, is_new = await state.analysis.stored(
            state.store.put_sequence_image, image, simulated
        )
    if is_new:
        record = await asyncio.to_thread(state.store.update_sequence, record.id, name=SAMPLE)
    return SequenceSummary.of(record)


@operation(media.STREAM, query=requests.EncodingTarget)
async def encoding(state: State, request: Request, report: Reporter) -> Outcome:
    """Encode a stored sequence."""
    path = await asyncio.to_thread(state.store.sequence_path, request.sequence_id)
    return await encoded(state, path, request.query, report)


async def encoded(
    state: State, source: Upload | Path, target: requests.EncodingTarget, report: Reporter
) -> Outcome:
    """Have a worker encode a sequence."""
    with state.analysis.output() as output:
        answer = await state.analysis.followed(
            report, sequences.encode_sequence, source, target, output
        )
    return Outcome(output, media.STREAM, headers=answer.headers)


@operation(media.JSON, media.PNG, query=requests.TRADE)
async def tradeoff(state: State, request: Request, report: Reporter) -> Outcome:
    """Measure a trade of modes for accuracy on a stored sequence."""
    analysis, query, sequence_id = state.analysis, request.query, request.sequence_id
    sequence = await asyncio.to_thread(state.store.sequence_path, sequence_id)
    parameters = query.parameters()
    with analysis.output() as output:
        await analysis.followed(
            *(report, signatures.measure_trade),
            *(sequence, parameters, query.front_modes, query.only),
            *(analysis.template_path(parameters), request.media_type, output),
            state.store.sequence_record(sequence_id).facts,
        )
    return Outcome(output, request.media_type)


@operation(query=requests.SIGNATURE_OF_FILE)
async def template(state: State, request: Request, report: Reporter) -> Outcome:
    """Make and store the template of an upload."""
    parameters = request.query.parameters()
    with state.analysis.image() as image:
        answer = await state.analysis.followed(
            report, sequences.make_template, sent(state, request), parameters, image
        )
        is_new = await state.analysis.stored(state.store.put_template_image, image, answer.id)
    return made(
        answer, answer.links["self"], is_new, headers={"ETag": tag_of(answer.id, media.JSON)}
    )


@operation(media.JSON, media.PNG)
async def template_view(state: State, request: Request, _: Reporter) -> Outcome:
    """Describe or draw a stored template."""
    path = await asyncio.to_thread(state.store.template_path, request.reference)
    kind = request.media_type
    return Outcome(await state.analysis.work(sequences.show_template, path, kind), kind)


@operation(media.JSON, media.NPZ, media.HDF5, media.PNG, query=queries.ModesRequest)
async def template_modes(state: State, request: Request, _: Reporter) -> Outcome:
    """Give the vibration modes of a stored template."""
    path = await asyncio.to_thread(state.store.template_path, request.reference)
    body = await state.analysis.work(
        sequences.modes_of_template, path, request.query, request.media_type
    )
    return Outcome(body, request.media_type)


# Part of a tracked report that the track is counted as.
_TRACKING: Final = 0.8


@operation()
async def images(state: State, request: Request, report: Reporter) -> Outcome:
    """Read images and store them."""
    limits = replace(state.settings.read_limits, decompressed_bytes=state.settings.max_image_bytes)
    upload = Upload.at(state.spool.at(request.file), limits)
    with state.analysis.image() as file:
        read = await state.analysis.followed(report, tracks.ingest_images, upload, file)
        await asyncio.to_thread(spool.SpoolFile(file).make_durable)
        record, is_new = await state.analysis.stored(state.store.put_images, file, read)
    return made(ImagesSummary.of(record), link_of_images(record.id), is_new)


@operation(media.VIEW, query=queries.ImagesView)
async def slices(state: State, request: Request, _: Reporter) -> Outcome:
    """Give the slices of one frame of images, and a track's surface in it."""
    images_id, query, track = request.ids[0], request.query, None
    path = await asyncio.to_thread(state.store.images_path, images_id)
    if query.track is not None:
        track = await asyncio.to_thread(state.store.track_path, query.track)
    body = await state.analysis.work(tracks.show_slices, path, query.frame, track)
    return Outcome(body, media.VIEW)


def sweep_images(state: State, age: timedelta) -> Sequence[str]:
    """Forget images that nobody has tracked for so long; gives their ids."""
    past = index.to_text((datetime.now(UTC) - age).timestamp())
    old = state.store.untracked_images(past)
    for images_id in old:
        with contextlib.suppress(NotFoundError):
            forget_images(state, images_id)
    return old


async def start_path(state: State, start: str | None) -> Path | None:
    """File of the sequence that a track is started from.

    Raises
    ------
    NotFoundError
        If it is not there, or its vertices were not kept.
    """
    if start is None:
        return None
    return await asyncio.to_thread(state.store.sequence_path, start)


async def keep_or_delete_images(state: State, request: Request, link: str) -> None:
    """Keep the images of a track for its pictures, or delete them.

    Once nothing needs them any more: a job that is done again after a crash starts from them.
    """
    images_id, track_id = request.query.images, link.rpartition("/")[2]

    def end() -> None:
        # Deleted meanwhile, by their owner or by another track.
        with contextlib.suppress(NotFoundError):
            if request.query.keep:
                state.store.keep_images(images_id, track_id)
            elif not state.store.images_record(images_id).is_kept:
                forget_images(state, images_id)

    if images_id is not None:
        await asyncio.to_thread(end)


@operation(query=requests.TRACK, on_stored=keep_or_delete_images)
async def track(state: State, request: Request, report: Reporter) -> Outcome:
    """Track a surface through an upload or stored images, and store what is found."""
    query, analysis, store = request.query, state.analysis, state.store
    parameters, facts = query.parameters(request.facts), replace(request.facts, landmarks={})
    surface = await start_path(state, query.start)
    source: Upload | Path
    if query.images is not None:
        source = await asyncio.to_thread(store.images_path, query.images)
    else:
        source = Upload.at(state.spool.at(request.file), state.settings.read_limits)
    with analysis.image() as sequence, analysis.image() as image:
        found, estimate = await analysis.followed(
            *(report, tracks.follow, source, parameters, facts, surface, sequence, image)
        )
        subject, label = query.subject, query.label
        record, is_new = await analysis.stored(
            store.put_track_images, sequence, image, found, subject=subject, label=label
        )
    # Of a sequence that was there before, by itself or with this track.
    record, filled = await asyncio.to_thread(
        analysis.completed, record.id, subject, label, facts, found.facts
    )
    answer = TrackAnswer.joined(estimate, record, query.images if query.keep else None)
    return made(answer, answer.links["self"], is_new, filled=filled)


@operation(media.JSON, media.HDF5, media.PNG, media.VIEW, query=queries.TrackView)
async def track_view(state: State, request: Request, _: Reporter) -> Outcome:
    """Describe or draw a stored track, or give its file or its data."""
    track_id, kind, store = request.sequence_id, request.media_type, state.store
    path = await asyncio.to_thread(store.track_path, track_id)
    images_id, shown = await asyncio.to_thread(store.images_id_of_track, track_id), None
    if kind == media.PNG and request.query.picture == "overlay":
        shown = await asyncio.to_thread(store.images_of_track, track_id)
    record = store.track_record(track_id)
    body = await state.analysis.work(
        tracks.show_track, path, record, images_id, shown, request.query, kind
    )
    return Outcome(body, kind)


@operation(media.ZIP, query=requests.TRACK, is_job=True, on_stored=keep_or_delete_images)
async def tracked_report(state: State, request: Request, report: Reporter) -> Outcome:
    """Track a surface, name the class of its motion, and write each form of a report to a zip."""
    done = await track.work(state, request, part_of(report, 0.0, _TRACKING))
    track_id = (done.link or "").rpartition("/")[2]
    report(Progress(_TRACKING, stage="report"))
    path = await _whole_report(state, track_id, request.query.model)
    # The job ends with the track that its link names, and with it the file.
    headers = attachment(f"{track_id[:12]}-report.zip")
    return Outcome(path, media.ZIP, 200, headers, done.link, done.filled)


async def _whole_report(state: State, sequence_id: str, model: str | None) -> Path:
    known = None
    if model is not None:
        chosen = await asyncio.to_thread(models.choose_for, state, model, sequence_id)
        coverage = requests.ClassificationRequest().coverage
        known, _ = await models.classification(state, sequence_id, chosen, coverage)
    kept = None if known is None else known.path
    async with state.analysis.fitted(sequence_id, None) as one:
        return await state.analysis.written(signatures.make_whole_report, one, kept)


async def erase(state: State, sequence_id: str) -> None:
    """Delete a sequence with all that derives from it, and every mention of it elsewhere.

    Jobs about it are ended and forgotten, with the files that they have made: an encoded
    sequence is the sequence. So is a job of many sequences, for its file has this one too.

    Raises
    ------
    NotFoundError
        If there is no such sequence.
    StoreError
        If it cannot be deleted, or not wholly; then it can be deleted again.
    """
    await asyncio.to_thread(state.store.sequence_record, sequence_id)
    # Before the sequence itself: what fails here, or is cut short, is done by the next call.
    await forget(state, sequence_id)
    await asyncio.to_thread(state.store.delete_sequence, sequence_id)
    # Again, for jobs that were made meanwhile.
    await forget(state, sequence_id)


async def erase_images(state: State, images_id: str) -> None:
    """Delete images and every mention of them; jobs that read them end.

    Raises
    ------
    NotFoundError
        If there are none of that id.
    StoreError
        If they cannot be deleted, or not wholly; then they can be deleted again.
    """
    about = partial(state.jobs.about, images_id, link_of_images(images_id))
    await _end(state, await asyncio.to_thread(about))
    await asyncio.to_thread(forget_images, state, images_id)


def link_of_images(images_id: str) -> str:
    """Path of images."""
    return f"/v1/images/{images_id}"


def forget_images(state: State, images_id: str) -> None:
    """Delete images, with every mention of them by jobs that are finished and stored answers.

    Raises
    ------
    NotFoundError
        If there are none of that id.
    StoreError
        If they cannot be deleted, or not wholly; then they can be deleted again.
    """
    link = link_of_images(images_id)
    state.idempotency.replace_answers(link, *gone())
    # Not the one that was begun with them and is about to succeed: its result is its own. Slices
    # that nobody has fetched are the images as well.
    _forget_jobs(state, [job for job in state.jobs.about(images_id, link) if job.is_finished])
    state.store.delete_images(images_id)


async def _end(state: State, jobs: Iterable[Job]) -> None:
    for job in jobs:
        # One that ends by itself just now is as good.
        with contextlib.suppress(ConflictError, NotFoundError):
            await state.runner.cancel(job.id)


def _forget_jobs(state: State, jobs: Sequence[Job]) -> None:
    for name in results_of(jobs):
        state.spool.remove(name)
    state.jobs.forget(*(job.id for job in jobs))


async def forget(state: State, sequence_id: str) -> None:
    """End and forget jobs about a sequence, with their files, and stored answers about it."""
    # A track has the id of its sequence.
    for kind in ("sequences", "tracks", "signatures"):
        link = f"/v1/{kind}/{sequence_id}"
        about = partial(state.jobs.about, sequence_id, link)
        await _end(state, await asyncio.to_thread(about))
        await asyncio.to_thread(_forget_jobs, state, await asyncio.to_thread(about))
        await asyncio.to_thread(state.idempotency.replace_answers, link, *gone())


async def restate(
    state: State,
    sequence_id: str,
    stated: requests.SequenceChange,
    change: Callable[[SequenceRecord], SequenceRecord],
) -> SequenceRecord:
    """Put a sequence with what is stated in the place of another, its track with it.

    Images that were kept for it stay, and jobs and answers about the old one go.

    Parameters
    ----------
    state : State
    sequence_id : str
    stated : requests.SequenceChange
        Unit and times that it does not state stay.
    change : callable
        Makes of its record that of the new one: name, subject, label and facts.

    Raises
    ------
    NotFoundError
        If there is no such sequence, or its vertices were not kept.
    InputError
        If the times are not those of its frames, or contradict its facts.
    """
    store = state.store
    known = await asyncio.to_thread(store.sequence_record, sequence_id)
    path = await asyncio.to_thread(store.sequence_path, sequence_id)
    track = state.analysis.track_path(sequence_id)
    facts = change(known).facts
    what: dict[str, Any] = {
        name: getattr(stated, name) for name in ("unit", "times") if name in stated.model_fields_set
    }
    with state.analysis.image() as sequence, state.analysis.image() as tracked:
        record = await state.analysis.work(
            sequences.restated, path, track, what, facts, sequence, tracked
        )
        if record.id == sequence_id:
            return known
        made = None if track is None else tracked
        await forget(state, sequence_id)
        record = await state.analysis.stored(
            store.replace_sequence, sequence_id, sequence, record, change, made
        )
        # Again, for jobs that were made meanwhile.
        await forget(state, sequence_id)
    return record
