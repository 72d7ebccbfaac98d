"""Operations on files that are sent, of which nothing is stored, one or many in a request."""

from __future__ import annotations

import asyncio
import json
import logging
import zipfile
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from modalmotion.errors import ModalMotionError, StoreError
from modalmotion.store.disk import cannot_write
from modalmotion_service.errors import ClusterError
from modalmotion_service.http import negotiation as media
from modalmotion_service.http.observation import add_milliseconds, stage
from modalmotion_service.http.problems import internal_problem, problem_body
from modalmotion_service.schemas.queries import DecodingRequest
from modalmotion_service.schemas.requests import CLASS_OF_FILE, ENCODING_OF_FILE, SIGNATURE_OF_FILE
from modalmotion_service.work.tasks import sequences, signatures
from modalmotion_service.work.tasks.classification import classify_upload
from modalmotion_service.work.tasks.signatures import RESULTS
from modalmotion_service.work.upload import Part, Upload
from modalmotion_service.workspace import models
from modalmotion_service.workspace.job_runner import Report
from modalmotion_service.workspace.operation import Outcome, Request, State, operation
from modalmotion_service.workspace.recording_operations import encoded, sent
from modalmotion_service.workspace.signature_operations import SIGNATURE_TYPES
from modalmotion_service.workspace.spool import SpoolFile

logger = logging.getLogger(__name__)

FAILED: Final = "Batch-Failed"
"""Header with the number of files that have a problem in the place of a result."""

_SUFFIX: Final = ".h5"


@dataclass(frozen=True)
class _Outcome:
    part: Part
    body: bytes | None
    problem: dict[str, object] | None


def _upload(state: State, request: Request, part: Part) -> Upload:
    options = request.query.options(state.settings.read_limits, part.facts)
    return Upload(state.spool.at(request.file), options, part)


async def _each(
    state: State,
    parts: tuple[Part, ...],
    work: Callable[[Part], Awaitable[bytes]],
    report: Report,
) -> AsyncIterator[_Outcome]:
    """Do all in order, a few at a time: what is done ahead of its turn is held in memory.

    Raises
    ------
    StoreError, ClusterError
        If it is no fault of a file: all is to be done again.
    """
    ahead = 2 * state.analysis.engine.n_workers + 2
    under_way: deque[tuple[Part, asyncio.Task[bytes]]] = deque()
    rest = iter(parts)
    try:
        for done in range(len(parts)):
            while len(under_way) < ahead and (part := next(rest, None)) is not None:
                under_way.append((part, asyncio.ensure_future(work(part))))
            first, task = under_way.popleft()
            try:
                outcome = _Outcome(first, await task, None)
            except (StoreError, ClusterError):
                raise
            except ModalMotionError as error:
                outcome = _Outcome(first, None, problem_body(error))
            except Exception:
                logger.exception("a file of many failed")
                outcome = _Outcome(first, None, internal_problem())
            report((done + 1) / len(parts), f"file {done + 1} of {len(parts)}")
            yield outcome
    finally:
        for _, task in under_way:
            task.cancel()
        await asyncio.gather(*(task for _, task in under_way), return_exceptions=True)


@contextmanager
def _written(state: State) -> Iterator[Path]:
    """Name a file that this process writes; it is removed if it cannot be."""
    with state.analysis.output() as output, stage("worker"):
        try:
            yield output
        except OSError as error:
            raise cannot_write(output, error) from error


async def _listed(
    state: State, outcomes: AsyncIterator[_Outcome], member: str, media_type: str
) -> Outcome:
    """Write results as the members of a list, or a line each."""
    n_failed, is_list = 0, media_type == media.JSON
    with _written(state) as output, output.open("xb") as file:
        file.write(b'{"results":[' if is_list else b"")
        between = b""
        async for one in outcomes:
            n_failed += one.problem is not None
            file.write(between + _line(one, member))
            between = b",\n" if is_list else b"\n"
        file.write(b'],"n_failed":%d}' % n_failed if is_list else b"\n")
    return Outcome(output, media_type, headers={FAILED: str(n_failed)})


async def _archived(state: State, outcomes: AsyncIterator[_Outcome]) -> tuple[Path, int]:
    """Write signatures as files of an archive; gives the number of problems besides."""
    listed = list[dict[str, Any]]()
    with _written(state) as output, zipfile.ZipFile(output, "x") as archive:
        async for one in outcomes:
            name = None if one.body is None else f"{len(listed):06d}{_SUFFIX}"
            if name is not None and one.body is not None:
                archive.writestr(name, one.body)
            listed.append({**_named(one.part), "file": name, "error": one.problem})
        n_failed = sum(one["error"] is not None for one in listed)
        archive.writestr(RESULTS, json.dumps({"results": listed, "n_failed": n_failed}))
    return output, n_failed


def _named(part: Part) -> dict[str, Any]:
    return {"name": part.name, "subject": part.subject, "label": part.label}


def _line(one: _Outcome, member: str) -> bytes:
    """Write a result with the answer of a worker as it is."""
    head = json.dumps(_named(one.part))[:-1].encode()
    body = b"null" if one.body is None else one.body
    problem = json.dumps(one.problem).encode()
    return b'%s, "%s": %s, "error": %s}' % (head, member.encode(), body, problem)


async def _signed(
    state: State, upload: Upload, request: Request, media_type: str
) -> tuple[bytes, dict[str, float]]:
    parameters = request.query.parameters()
    template = state.analysis.template_path(parameters)
    return await state.analysis.work(
        signatures.sign_upload, upload, parameters, template, media_type
    )


@operation(*SIGNATURE_TYPES, query=SIGNATURE_OF_FILE)
async def sent_signature(state: State, request: Request, _: Report) -> Outcome:
    """Fit an upload."""
    with stage("worker"):
        body, milliseconds = await _signed(state, sent(state, request), request, request.media_type)
    add_milliseconds(milliseconds)
    return Outcome(body, request.media_type)


@operation(media.JSON, media.NDJSON, media.HDF5, media.ZIP, media.CSV, query=SIGNATURE_OF_FILE)
async def sent_signatures(state: State, request: Request, report: Report) -> Outcome:
    """Fit each of many files that came in one request."""
    media_type, analysis = request.media_type, state.analysis
    analysis.template_path(request.query.parameters())
    one_type = media.JSON if media_type in (media.JSON, media.NDJSON) else media.HDF5

    async def fit(part: Part) -> bytes:
        body, _ = await _signed(state, _upload(state, request, part), request, one_type)
        return body

    outcomes = _each(state, request.parts, fit, report)
    if one_type == media.JSON:
        return await _listed(state, outcomes, "signature", media_type)
    archive, n_failed = await _archived(state, outcomes)
    headers = {FAILED: str(n_failed)}
    if media_type == media.ZIP:
        return Outcome(archive, media.ZIP, headers=headers)
    task = signatures.pack_archive if media_type == media.HDF5 else signatures.tabulate_archive
    try:
        output = await analysis.written("worker", task, archive, request.parts)
    finally:
        SpoolFile(archive).remove()
    return Outcome(output, media_type, headers=headers)


async def _classified(
    state: State, upload: Upload, model: models.ChosenModel, coverage: float
) -> bytes:
    with stage("worker"):
        return await state.analysis.work(
            classify_upload, upload, model.parameters, model.source, coverage, model.version
        )


@operation(query=CLASS_OF_FILE)
async def sent_classification(state: State, request: Request, _: Report) -> Outcome:
    """Classify the motion in an upload."""
    model = await asyncio.to_thread(models.choose, state, request.query.model)
    upload = sent(state, request)
    return Outcome(await _classified(state, upload, model, request.query.coverage))


@operation(media.JSON, media.NDJSON, query=CLASS_OF_FILE)
async def sent_classifications(state: State, request: Request, report: Report) -> Outcome:
    """Classify the motion in each of many files that came in one request."""
    model = await asyncio.to_thread(models.choose, state, request.query.model)

    async def name(part: Part) -> bytes:
        upload = _upload(state, request, part)
        return await _classified(state, upload, model, request.query.coverage)

    outcomes = _each(state, request.parts, name, report)
    return await _listed(state, outcomes, "classification", request.media_type)


@operation(media.STREAM, query=ENCODING_OF_FILE)
async def sent_encoding(state: State, request: Request, report: Report) -> Outcome:
    """Encode an upload."""
    return await encoded(state, sent(state, request), request.query.target, report)


@operation(media.NPZ, media.VTKHDF, media.RAW, query=DecodingRequest)
async def decoding(state: State, request: Request, _: Report) -> Outcome:
    """Decode a stream, or a part of it."""
    frames, vertices = request.query.ranges()
    stream, limits = state.spool.at(request.file), state.settings.read_limits
    output = await state.analysis.written(
        "decode", sequences.decode_upload, stream, limits, frames, vertices, request.media_type
    )
    return Outcome(output, request.media_type)
