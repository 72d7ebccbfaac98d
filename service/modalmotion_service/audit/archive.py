"""Archiving of closed files of the audit log."""

from __future__ import annotations

import hashlib
from datetime import datetime
from pathlib import Path

from modalmotion.errors import CorruptFileError, ParameterError
from modalmotion.progress import Progress
from modalmotion.store.disk.atomic import remove_durably, write_atomic
from modalmotion.store.index.cursor import to_text
from modalmotion_service.audit.check import check_audit
from modalmotion_service.audit.entry import Place
from modalmotion_service.audit.log import audit_folder, parts_in
from modalmotion_service.audit.part import AuditPart


def archive_audit(
    data_dir: Path,
    target: Path,
    *,
    older_than: datetime | None = None,
    progress: Progress | None = None,
) -> list[Place]:
    """Move closed files of the log to another folder; a server may go on writing.

    Each is checked, copied durably and compared before it is removed here, the oldest first, so
    that what remains is without gaps whenever this is interrupted.

    Parameters
    ----------
    data_dir : Path
    target : Path
        Made where it is missing; may hold earlier archives.
    older_than : datetime, optional
        With its time zone: only files whose last entry was written before.
    progress : callable, optional
        Called with (files moved, files to move).

    Returns
    -------
    list of Place
        Of the last entry of each file that was moved.

    Raises
    ------
    CorruptFileError
        If a file was altered: it stays where it is, and those after it.
    ParameterError
        If the target is the log's own folder, or has another file of the same name.
    """
    folder = audit_folder(data_dir)
    if target.resolve() == folder.resolve():
        raise ParameterError("An archive is another folder.", remedy="Name another folder.")
    movable = []
    # The last file is appended to, or has just been closed and is what the next one begins from.
    for part in parts_in(folder)[:-1]:
        last = part.last_time()
        if older_than is not None and (last is None or last >= to_text(older_than.timestamp())):
            break
        movable.append(part)
    if movable:
        target.mkdir(mode=0o700, parents=True, exist_ok=True)
    moved = []
    for number, part in enumerate(movable):
        moved.append(_move(part, target / part.path.name))
        if progress is not None:
            progress(number + 1, len(movable))
    return moved


def _move(part: AuditPart, copy: Path) -> Place:
    report = check_audit([part], noted=part.start())
    if report.faults:
        raise CorruptFileError(
            f"{part.path.name} is not archived: {report.faults[0]}.",
            remedy="See the output of `modalmotion audit verify`, and restore it from a backup.",
        )
    part.settle()
    content = part.path.read_bytes()
    if not copy.exists():
        write_atomic(copy, content)
        copy.chmod(0o400)
    if _digest(copy.read_bytes()) != _digest(content):
        raise ParameterError(
            f"The archive has another {copy.name}.",
            remedy="Name a folder of its own for the log of each data folder.",
        )
    remove_durably(part.path)
    return report.end


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
