"""A sequence, or images, deleted or replaced, with jobs, their files, and stored answers."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

from modalmotion.errors import NotFoundError
from modalmotion.store import SequenceRecord
from modalmotion_service.errors import ConflictError
from modalmotion_service.http.observation import stage
from modalmotion_service.schemas.requests import SequenceChange
from modalmotion_service.work.tasks.sequences import restated
from modalmotion_service.workspace.jobs import Job, gone, results_of
from modalmotion_service.workspace.operation import State


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
    stated: SequenceChange,
    change: Callable[[SequenceRecord], SequenceRecord],
) -> SequenceRecord:
    """Put a sequence with what is stated in the place of another, its track with it.

    Images that were kept for it stay, and jobs and answers about the old one go.

    Parameters
    ----------
    state : State
    sequence_id : str
    stated : SequenceChange
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
        with stage("worker"):
            record = await state.analysis.work(
                restated, path, track, what, facts, sequence, tracked
            )
        if record.id == sequence_id:
            return known
        made = None if track is None else tracked
        await forget(state, sequence_id)
        with stage("store"):
            record = await asyncio.to_thread(
                store.replace_sequence, sequence_id, sequence, record, change, made
            )
        # Again, for jobs that were made meanwhile.
        await forget(state, sequence_id)
    return record
