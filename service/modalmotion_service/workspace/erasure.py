"""Deleting a sequence with its jobs, their files, and stored answers."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json

from modalmotion.errors import NotFoundError
from modalmotion_service.errors import ConflictError
from modalmotion_service.http.problems import problem_body
from modalmotion_service.workspace.state import State


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
    await _forget(state, sequence_id)
    await asyncio.to_thread(state.store.delete_sequence, sequence_id)
    # Again, for jobs that were made meanwhile.
    await _forget(state, sequence_id)


async def _forget(state: State, sequence_id: str) -> None:
    # A track has the id of its sequence.
    for kind in ("sequences", "tracks"):
        await _forget_at(state, sequence_id, f"/v1/{kind}/{sequence_id}")


async def _forget_at(state: State, sequence_id: str, link: str) -> None:
    for job in await asyncio.to_thread(state.jobs.about, sequence_id, link):
        # One that ends by itself just now is as good.
        with contextlib.suppress(ConflictError, NotFoundError):
            await state.runner.cancel(job.id)
    about = await asyncio.to_thread(state.jobs.about, sequence_id, link)
    for job in about:
        if "file" in (job.result or {}):
            state.spool.remove(job.result["file"])
    await asyncio.to_thread(state.jobs.forget, *(job.id for job in about))
    status, answer = _gone()
    await asyncio.to_thread(state.idempotency.replace_answers, link, status, answer)


def _gone() -> tuple[int, dict[str, object]]:
    """Answer to a request that is sent again after its result was deleted."""
    body = problem_body(
        NotFoundError(
            "The result of this request has been deleted since.",
            remedy="Send it with a new Idempotency-Key to have it again.",
        )
    )
    text = base64.b64encode(json.dumps(body).encode()).decode("ascii")
    status = body["status"]
    assert isinstance(status, int)  # noqa: S101 (as `problem_body` makes it)
    return status, {"body": text, "headers": {"content-type": "application/problem+json"}}
