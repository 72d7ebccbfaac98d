"""A sequence with another unit or other times, which is another sequence."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any

from modalmotion.errors import NotFoundError
from modalmotion.mesh import Facts
from modalmotion_service.http.timing import stage
from modalmotion_service.schemas.requests import SequenceChange
from modalmotion_service.work.tasks.sequences import restated
from modalmotion_service.workspace.state import State


async def restate(
    state: State, sequence_id: str, stated: SequenceChange, change: Callable[[Facts], Facts]
) -> str:
    """Store a sequence again with what is stated, its track with it; give the id of that.

    Name, subject, label and facts come along, and images that were kept; the old one stays, for
    the caller to delete.

    Parameters
    ----------
    state : State
    sequence_id : str
    stated : SequenceChange
        Unit and times that it does not state stay.
    change : callable
        What becomes of its facts.

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
    track = None
    with contextlib.suppress(NotFoundError):
        track = await asyncio.to_thread(store.track_path, sequence_id)
    images_id = await asyncio.to_thread(store.images_id_of_track, sequence_id)
    facts = change(known.facts)
    what: dict[str, Any] = {
        name: getattr(stated, name) for name in ("unit", "times") if name in stated.model_fields_set
    }
    with state.analysis.image() as sequence, state.analysis.image() as tracked:
        with stage("worker"):
            record = await state.analysis.work(
                restated, path, track, what, facts, sequence, tracked
            )
        with stage("store"):
            if track is None:
                await asyncio.to_thread(store.put_sequence_image, sequence, record)
            else:
                await asyncio.to_thread(store.put_track_images, sequence, tracked, record)
    await asyncio.to_thread(
        store.update_sequence,
        record.id,
        name=known.name,
        subject=known.subject,
        label=known.label,
        change=lambda _: facts,
    )
    if images_id is not None and record.id != sequence_id:
        await asyncio.to_thread(store.keep_images, images_id, record.id)
    return record.id
