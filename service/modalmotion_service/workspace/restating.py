"""A sequence with another unit or other times, which is another sequence."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from modalmotion.store import SequenceRecord
from modalmotion_service.http.timing import stage
from modalmotion_service.schemas.requests import SequenceChange
from modalmotion_service.work.tasks.sequences import restated
from modalmotion_service.workspace.erasure import forget
from modalmotion_service.workspace.state import State


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
