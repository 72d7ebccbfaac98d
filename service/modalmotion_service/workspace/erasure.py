"""Deleting a sequence, or images, with jobs, their files, and stored answers."""

from __future__ import annotations

import asyncio
import contextlib

from modalmotion.errors import NotFoundError
from modalmotion_service.errors import ConflictError
from modalmotion_service.workspace.gone import gone
from modalmotion_service.workspace.jobs import results_of
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
    for job in await asyncio.to_thread(state.images.about, images_id):
        # One that ends by itself just now is as good.
        with contextlib.suppress(ConflictError, NotFoundError):
            await state.runner.cancel(job.id)
    await asyncio.to_thread(state.images.forget, images_id)


async def forget(state: State, sequence_id: str) -> None:
    """End and forget jobs about a sequence, with their files, and stored answers about it."""
    # A track has the id of its sequence.
    for kind in ("sequences", "tracks", "signatures"):
        await _forget_at(state, sequence_id, f"/v1/{kind}/{sequence_id}")


async def _forget_at(state: State, sequence_id: str, link: str) -> None:
    for job in await asyncio.to_thread(state.jobs.about, sequence_id, link):
        # One that ends by itself just now is as good.
        with contextlib.suppress(ConflictError, NotFoundError):
            await state.runner.cancel(job.id)
    about = await asyncio.to_thread(state.jobs.about, sequence_id, link)
    for name in results_of(about):
        state.spool.remove(name)
    await asyncio.to_thread(state.jobs.forget, *(job.id for job in about))
    await asyncio.to_thread(state.idempotency.replace_answers, link, *gone())
