"""Operations on files that are sent, of which nothing is stored, one or many in a request."""

import asyncio
import json
import logging
from collections import deque
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Final

from modalmotion.errors import ModalMotionError, StoreError
from modalmotion.progress import Progress, Reporter
from modalmotion.store.disk import cannot_write
from modalmotion_service.errors import ClusterError
from modalmotion_service.http import negotiation as media
from modalmotion_service.http import problems
from modalmotion_service.schemas import queries, requests
from modalmotion_service.work.tasks import sequences, signatures
from modalmotion_service.work.tasks.classification import classify_upload
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace import models, signature_operations
from modalmotion_service.workspace.operation import Outcome, Request, State, operation
from modalmotion_service.workspace.recording_operations import encoded, sent

logger = logging.getLogger(__name__)

FAILED: Final = "Batch-Failed"
"""Header with the number of files that have a problem in the place of a result."""


async def _each(
    state: State,
    request: Request,
    work: Callable[[Upload], Awaitable[bytes]],
    member: str,
    report: Reporter,
) -> Outcome:
    """Do the same for all, a few at a time, and write what they give in their order.

    As the members of a list, or a line each. What is done ahead of its turn is held in memory.

    Raises
    ------
    StoreError, ClusterError
        If it is no fault of a file: all is to be done again.
    """
    options = partial(request.query.options, state.settings.read_limits)
    path, n_failed, n = state.spool.at(request.file), 0, len(request.parts)
    opening, between, closing = b"", b"\n", b"\n"
    if request.media_type == media.JSON:
        opening, between, closing = b'{"results":[', b",\n", b'],"n_failed":%d}'
    uploads = (Upload(path, options(part.facts), part) for part in request.parts)
    under_way: deque[asyncio.Task[bytes]] = deque()
    with state.analysis.output() as output:
        try:
            with output.open("xb") as file:
                for number, part in enumerate(request.parts):
                    while len(under_way) < 2 * state.analysis.engine.n_workers + 2:
                        if (upload := next(uploads, None)) is None:
                            break
                        under_way.append(asyncio.ensure_future(work(upload)))
                    body, problem = await _outcome(under_way.popleft())
                    n_failed += problem is not None
                    head = json.dumps(
                        {"name": part.name, "subject": part.subject, "label": part.label}
                    )
                    file.write(between if number else opening)
                    file.write(b'%s, "%s": %s' % (head[:-1].encode(), member.encode(), body))
                    file.write(b', "error": %s}' % json.dumps(problem).encode())
                    report(Progress(number + 1, n, f"file {number + 1} of {n}"))
                file.write(closing % n_failed if b"%d" in closing else closing)
        except OSError as error:
            raise cannot_write(output, error) from error
        finally:
            for task in under_way:
                task.cancel()
            await asyncio.gather(*under_way, return_exceptions=True)
    return Outcome(output, request.media_type, headers={FAILED: str(n_failed)})


async def _outcome(task: asyncio.Task[bytes]) -> tuple[bytes, dict[str, object] | None]:
    """Give the answer of a worker as it is, or the problem of a file."""
    try:
        return await task, None
    except (StoreError, ClusterError):
        raise
    except ModalMotionError as error:
        return b"null", problems.problem_body(error)
    except Exception:
        logger.exception("a file of many failed")
        return b"null", problems.internal_problem()


async def _signed(state: State, upload: Upload, request: Request, media_type: str) -> bytes:
    parameters, analysis = request.query.parameters(), state.analysis
    template = analysis.template_path(parameters)
    return await analysis.work(signatures.sign_upload, upload, parameters, template, media_type)


@operation(*signature_operations.SIGNATURE_TYPES, query=requests.SIGNATURE_OF_FILE)
async def sent_signature(state: State, request: Request, _: Reporter) -> Outcome:
    """Fit an upload."""
    kind = request.media_type
    return Outcome(await _signed(state, sent(state, request), request, kind), kind)


@operation(media.JSON, media.NDJSON, query=requests.SIGNATURE_OF_FILE)
async def sent_signatures(state: State, request: Request, report: Reporter) -> Outcome:
    """Fit each of many files that came in one request."""
    state.analysis.template_path(request.query.parameters())

    async def fit(upload: Upload) -> bytes:
        return await _signed(state, upload, request, media.JSON)

    return await _each(state, request, fit, "signature", report)


async def _classified(
    state: State, upload: Upload, model: models.ChosenModel, coverage: float
) -> bytes:
    return await state.analysis.work(
        classify_upload, upload, model.parameters, model.source, coverage, model.version
    )


@operation(query=requests.CLASS_OF_FILE)
async def sent_classification(state: State, request: Request, _: Reporter) -> Outcome:
    """Classify the motion in an upload."""
    model = await asyncio.to_thread(models.choose, state, request.query.model)
    upload = sent(state, request)
    return Outcome(await _classified(state, upload, model, request.query.coverage))


@operation(media.JSON, media.NDJSON, query=requests.CLASS_OF_FILE)
async def sent_classifications(state: State, request: Request, report: Reporter) -> Outcome:
    """Classify the motion in each of many files that came in one request."""
    model = await asyncio.to_thread(models.choose, state, request.query.model)

    async def name(upload: Upload) -> bytes:
        return await _classified(state, upload, model, request.query.coverage)

    return await _each(state, request, name, "classification", report)


@operation(media.STREAM, query=requests.ENCODING_OF_FILE)
async def sent_encoding(state: State, request: Request, report: Reporter) -> Outcome:
    """Encode an upload."""
    return await encoded(state, sent(state, request), request.query.target, report)


@operation(media.NPZ, media.VTKHDF, media.RAW, query=queries.DecodingRequest)
async def decoding(state: State, request: Request, _: Reporter) -> Outcome:
    """Decode a stream, or a part of it."""
    frames: range | None = request.query.frames
    stream, limits = state.spool.at(request.file), state.settings.read_limits
    output = await state.analysis.written(
        sequences.decode_upload, stream, limits, frames, request.media_type
    )
    return Outcome(output, request.media_type)
