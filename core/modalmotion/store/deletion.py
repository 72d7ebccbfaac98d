"""Deletions, in steps that a crash may part, and the tombstones that they leave.

The record of a sequence is renamed first: from then on it is gone, and the next `open` of the store
takes any remaining steps. A tombstone tells that a thing was deleted on purpose, by its digest and
the time alone: a file that is missing is either deleted or lost, and nothing else tells which.
Backups read it, and `rebuild` and `restore`, which bring nothing back that was deleted.
"""

import contextlib
import hashlib
import re
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path, PurePath
from typing import Final

from modalmotion.classification.card import ModelRecord, ModelReference
from modalmotion.errors import StoreError
from modalmotion.store import disk, folders
from modalmotion.store.index import Index, model_from, model_values, now, to_text

TOMBSTONES: Final = "deleted"
"""Folder of a store that they are in."""
TOMBSTONE_DAYS: Final = 90
"""How long they are kept: a backup that is older than this no longer learns of a deletion."""

# Times of files come from a clock that moves in steps, and may lag by one.
_STEP_SECONDS: Final = 0.01

_OWNERS: Final = "owners"
_NORMS: Final = "norms"
_BY_ID: Final = (
    *("sequences", "signatures", "classifications", "tracks"),
    *("templates", "images"),
)
_ID: Final = re.compile(r"[0-9a-f]{64}")


def bury(root: Path, digest: str) -> None:
    """Note durably that the thing of a digest is deleted.

    Raises
    ------
    StoreError
        If it cannot be written.
    """
    path = _path(root, digest)
    disk.make_folder(path.parent)
    disk.write_atomic(path, now().encode())


def bury_and_remove(root: Path, digest: str, *files: Path) -> None:
    """Note that a thing is deleted, and remove its files.

    Raises
    ------
    StoreError
        If either fails; some files may be gone.
    """
    try:
        bury(root, digest)
    except StoreError:
        # On a full disk the files themselves make room for it.
        disk.remove_durably(*files)
        bury(root, digest)
    else:
        disk.remove_durably(*files)


def buried(root: Path, digest: str) -> str | None:
    """When a thing was deleted last, as `now` writes it; None if nothing is known of that."""
    with contextlib.suppress(OSError, UnicodeDecodeError):
        return _path(root, digest).read_text("ascii")
    return None


def is_older(written: float, deletion: str) -> bool:
    """Whether a file that was written then, s since 1970, was there when a thing was deleted."""
    return to_text(written + _STEP_SECONDS) <= deletion


def forget_tombstones(root: Path, days: float = TOMBSTONE_DAYS) -> int:
    """Remove tombstones that are older, and return how many.

    Raises
    ------
    StoreError
        If one cannot be removed.
    """
    past = time.time() - days * 86400
    old = [path for path in (root / TOMBSTONES).glob("*/*") if path.stat().st_mtime < past]
    disk.remove_durably(*old)
    return len(old)


def digest_of_owner(owner: str) -> str:
    """Digest that an owner's whole store is known by among deleted things."""
    return hashlib.sha256(f"{_OWNERS}/{owner}".encode()).hexdigest()


def digest_of_norm(name: str) -> str:
    """Digest that a norm is known by among deleted things."""
    return hashlib.sha256(f"{_NORMS}/{name}".encode()).hexdigest()


def was_deleted(root: Path, name: PurePath, written: float) -> bool:
    """Whether a folder of one store, or of a service, knows that a file was deleted on purpose.

    Parameters
    ----------
    root : Path
    name : PurePath
        Within the folder.
    written : float, s
        When the file was written, since 1970: what is newer than the deletion came after it.
    """
    for store, digest in _things(root, name):
        time_of = buried(store, digest)
        if time_of is not None and is_older(written, time_of):
            return True
        # A deletion that is under way: its record is under another name.
        if (store / "sequences" / digest[:2] / f"{digest}.deleted").exists():
            return True
    is_model = name.suffix == ".h5" and name.parent.parent.name == "models"
    return is_model and (root / name).with_suffix(".deleted").exists()


def _things(root: Path, name: PurePath) -> Iterator[tuple[Path, str]]:
    """List the things that a file belongs to, each with the store that would know of its end."""
    parts = name.parts
    if parts[0] == _OWNERS and len(parts) > 2:
        yield root, digest_of_owner(parts[1])
        yield from _things(root / _OWNERS / parts[1], PurePath(*parts[2:]))
    elif parts[0] in _BY_ID and _ID.match(name.name):
        yield root, name.name[:64]
        if parts[0] == "signatures":
            yield root, name.stem
    elif parts[0] == _NORMS:
        yield root, digest_of_norm(name.stem)


def _path(root: Path, digest: str) -> Path:
    # Once more: after a deletion not even the id is found in the folder.
    name = hashlib.sha256(f"deleted {digest}".encode()).hexdigest()
    return root / TOMBSTONES / name[:2] / name


def begin_deletion(folder: folders.Folder, sequence_id: str) -> None:
    """Mark a sequence as deleted, durably.

    Raises
    ------
    StoreError
        If that fails; nothing is changed then.
    """
    record, mark = folder.path("records", sequence_id), folder.path("deletions", sequence_id)
    if record.is_file():
        disk.rename(record, mark)
    else:
        disk.write_atomic(mark, b"")


def finish_deletion(folder: folders.Folder, index: Index, sequence_id: str) -> None:
    """Remove everything of a sequence that is marked as deleted.

    Raises
    ------
    StoreError
        If a step fails; the mark stays then, and this can be called again.
    """
    # Files before the index: on a full disk the index has no room to change until they go.
    files = [folder.path("uploads", sequence_id), folder.path("records", sequence_id)]
    try:
        disk.remove_durably(*files, *folder.derived(sequence_id))
        index.change(without=sequence_id)
        # Before the mark goes: without either, a backup would take the files for lost.
        bury(folder.root, sequence_id)
        disk.remove_durably(folder.path("deletions", sequence_id))
    except StoreError as error:
        raise StoreError(
            f"The deletion of sequence {sequence_id[:12]} has begun, but could not be finished: "
            f"{error.message}",
            remedy=f"Remove the cause, then delete it again or reopen the store. {error.remedy}",
            details=error.details,
        ) from error


FORM: Final = disk.JsonForm(
    "deleted-model",
    1,
    "Restore it from a copy. Keep the file in any case: it reserves the version number.",
)


def begin_model_deletion(folder: folders.Folder, record: ModelRecord) -> ModelRecord:
    """Note durably that a version is deleted, and give its record from then on.

    Raises
    ------
    StoreError
        If that fails; nothing is changed then.
    """
    gone = replace(record, deleted=now())
    disk.write_atomic(
        folder.path("deleted_models", record.reference), FORM.write(model_values(gone))
    )
    return gone


def deleted_record(path: Path, reference: ModelReference) -> ModelRecord:
    """Read what is known of a deleted version.

    Raises
    ------
    CorruptFileError
        If the file is damaged, or is another version's.
    StoreError
        If it was written by another version.
    """
    record = model_from(FORM.read(path))
    if record.reference != reference:
        raise FORM.damaged(path, "it belongs to another version")
    return record
