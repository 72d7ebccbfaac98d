"""Deleting a sequence with all that derives from it, in steps that a crash may part.

The record is renamed first: from then on the sequence is gone, and the next `open` of
the store takes any remaining steps.
"""

from __future__ import annotations

from modalmotion.errors import StoreError
from modalmotion.store.disk.atomic import cannot_write, remove_durably, sync_folder, write_atomic
from modalmotion.store.folder import Folder
from modalmotion.store.index.index import Index
from modalmotion.store.tombstones import bury


def begin_deletion(folder: Folder, sequence_id: str) -> None:
    """Mark a sequence as deleted, durably.

    Raises
    ------
    StoreError
        If that fails; nothing is changed then.
    """
    record, mark = folder.record(sequence_id), folder.deletion(sequence_id)
    if not record.is_file():
        write_atomic(mark, b"")
        return
    try:
        record.replace(mark)
        try:
            sync_folder(mark.parent)
        except BaseException:
            mark.replace(record)
            raise
    except OSError as error:
        raise cannot_write(mark, error) from error


def finish_deletion(folder: Folder, index: Index, sequence_id: str) -> None:
    """Remove everything of a sequence that is marked as deleted.

    Raises
    ------
    StoreError
        If a step fails; the mark stays then, and this can be called again.
    """
    # Files before the index: on a full disk the index has no room to change until they go.
    files = [folder.upload(sequence_id), folder.record(sequence_id)]
    try:
        remove_durably(*files, *folder.derived(sequence_id))
        index.remove(sequence_id)
        # Before the mark goes: without either, a backup would take the files for lost.
        bury(folder.root, sequence_id)
        remove_durably(folder.deletion(sequence_id))
    except StoreError as error:
        raise StoreError(
            f"The deletion of sequence {sequence_id[:12]} has begun, but could not be finished: "
            f"{error.message}",
            remedy="Delete it again, or open the store again, when the cause is removed. "
            f"{error.remedy}",
            details=error.details,
        ) from error
