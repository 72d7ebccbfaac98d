"""Operations that store sequences and templates, and those on stored sequences."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any, Final

from modalmotion_service.http.negotiation import HDF5, JSON, NPZ, PNG, STREAM, tag_of
from modalmotion_service.http.observation import stage
from modalmotion_service.schemas.queries import ModesRequest
from modalmotion_service.schemas.requests import (
    SEQUENCE,
    SIGNATURE_OF_FILE,
    TRADE,
    EncodingTarget,
)
from modalmotion_service.schemas.sequences import SequenceSummary
from modalmotion_service.work.tasks import derived, sequences
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.job_runner import Report
from modalmotion_service.workspace.operation import Outcome, Request, made, operation
from modalmotion_service.workspace.state import State

SAMPLE: Final = "Sample heart (simulated)"
"""Name of the simulated heart."""


def sent(state: State, request: Request) -> Upload:
    """Give the upload of a request, to be read as it states."""
    options = request.query.options(state.settings.read_limits, request.facts)
    return Upload(state.spool.at(request.file), options)


@operation(query=SEQUENCE)
async def upload(state: State, request: Request, report: Report) -> Outcome:
    """Read an upload and store its sequence.

    Of a known sequence, what is stated with it and not known yet is filled in.
    """
    analysis, file = state.analysis, sent(state, request)
    subject, label = request.query.subject, request.query.label
    with analysis.image() as image:
        read, reading = await analysis.staged(report, sequences.ingest, file, image)
        with stage("store"):
            record, is_new = await asyncio.to_thread(
                state.store.put_sequence_image, image, read, subject=subject, label=label
            )
    filled: tuple[str, ...] = ()
    if not is_new:
        record, filled = await asyncio.to_thread(
            analysis.completed, record.id, subject, label, request.facts, read.facts
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
    tag = tag_of(summary.model_dump_json())
    return made(summary, summary.links["self"], is_new, filled=filled, headers={"ETag": tag})


async def sample(state: State) -> SequenceSummary:
    """Store a simulated heart, for who has none at hand."""
    with state.analysis.image() as image, stage("worker"):
        simulated = await state.analysis.work(sequences.sample, image)
        record, is_new = await asyncio.to_thread(state.store.put_sequence_image, image, simulated)
    if is_new:
        record = await asyncio.to_thread(state.store.update_sequence, record.id, name=SAMPLE)
    return SequenceSummary.of(record)


@operation(STREAM, query=EncodingTarget)
async def encoding(state: State, request: Request, report: Report) -> Outcome:
    """Encode a stored sequence."""
    path = await asyncio.to_thread(state.store.sequence_path, request.sequence_id)
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
    analysis, query, sequence_id = state.analysis, request.query, request.sequence_id
    sequence = await asyncio.to_thread(state.store.sequence_path, sequence_id)
    parameters = query.parameters()
    with analysis.output() as output:
        await analysis.staged(
            *(report, derived.measure_trade, sequence, parameters, query.front_modes, query.only),
            *(analysis.template_path(parameters), request.media_type, output),
            state.store.sequence_record(sequence_id).facts,
        )
    return Outcome(output, request.media_type)


@operation(query=SIGNATURE_OF_FILE)
async def template(state: State, request: Request, report: Report) -> Outcome:
    """Make and store the template of an upload."""
    parameters = request.query.parameters()
    with state.analysis.image() as image:
        (answer,) = await state.analysis.staged(
            report, sequences.make_template, sent(state, request), parameters, image
        )
        with stage("store"):
            is_new = await asyncio.to_thread(state.store.put_template_image, image, answer.id)
    return made(answer, answer.links["self"], is_new, headers={"ETag": tag_of(answer.id, JSON)})


@operation(JSON, PNG)
async def template_view(state: State, request: Request, _: Report) -> Outcome:
    """Describe or draw a stored template."""
    path = await asyncio.to_thread(state.store.template_path, request.reference)
    kind = request.media_type
    return Outcome(await state.analysis.work(sequences.show_template, path, kind), kind)


@operation(JSON, NPZ, HDF5, PNG, query=ModesRequest)
async def template_modes(state: State, request: Request, _: Report) -> Outcome:
    """Give the vibration modes of a stored template."""
    path = await asyncio.to_thread(state.store.template_path, request.reference)
    with stage("modes"):
        body = await state.analysis.work(
            sequences.modes_of_template, path, request.query, request.media_type
        )
    return Outcome(body, request.media_type)
