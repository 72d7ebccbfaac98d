"""The audit log: who did what to which id; appended to, never changed, and durable.

Entries are committed together: while one transaction reaches the disk, those that come wait for
the next. An answer leaves after its entry is on the disk. The log is a row of files: one that has
its number of entries is closed, and the chain goes on in the next.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
from pathlib import Path
from typing import Self

from modalmotion.errors import StoreError
from modalmotion_service.audit.entry import GENESIS, AuditEntry, Event, Place
from modalmotion_service.audit.heads import note_head
from modalmotion_service.audit.notes import Notes
from modalmotion_service.audit.part import AuditPart, AuditWriter, PartClosedError
from modalmotion_service.settings import ENTRIES_PER_FILE

logger = logging.getLogger(__name__)

_NOTE_SECONDS = 3600.0


class AuditLog(Notes):
    """The audit log of a data folder; server and command line may have it open at once.

    Parameters
    ----------
    data_dir : Path
    entries_per_file : int
        A file that holds as many is closed, and another one is begun.
    """

    def __init__(self, data_dir: Path, entries_per_file: int = ENTRIES_PER_FILE) -> None:
        super().__init__()
        self._folder = audit_folder(data_dir)
        self._entries_per_file = entries_per_file
        self._lock = threading.Lock()
        self._writer = self._newest()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Note the head and close the file."""
        self._try_to_note()
        with self._lock:
            self._writer.close()

    def note_head(self) -> Place:
        """Note number and digest of the last entry, beside the log and in the service's own log.

        Raises
        ------
        StoreError
            If it cannot be written.
        """
        with self._lock:
            return self._note_head()

    async def look_after(self) -> None:
        """Note the head now, and every hour."""
        while True:
            await asyncio.to_thread(self._try_to_note)
            await asyncio.sleep(_NOTE_SECONDS)

    def append(self, events: list[Event]) -> None:
        """Append events in one transaction.

        Raises
        ------
        StoreError
            If they cannot be written; then none of them is.
        """
        with self._lock:
            if self._writer.n_entries >= self._entries_per_file:
                with contextlib.suppress(PartClosedError):
                    self._writer.close_for_good()
                    with contextlib.suppress(StoreError):
                        self._note_head()
            while True:
                try:
                    self._writer.append(events)
                except PartClosedError:
                    # Opened before the old one is closed: if it cannot be, all is as it was.
                    newest = self._newest()
                    self._writer.close()
                    self._writer = newest
                else:
                    return

    def page(
        self, *, limit: int, before: int | None = None, owner: str | None = None
    ) -> list[AuditEntry]:
        """Read a page as `audit_page` does."""
        return audit_page(self._folder, limit=limit, before=before, owner=owner)

    def _note_head(self) -> Place:
        place = head_of(self._folder)
        if note_head(self._folder, place):
            logger.info("audit log", extra={"head": str(place)})
        return place

    def _try_to_note(self) -> None:
        try:
            self.note_head()
        except StoreError as error:
            logger.warning("the audit log's head is not noted", extra={"code": error.code})

    def _newest(self) -> AuditWriter:
        """Open the file that is appended to: the last one, or the one after it."""
        parts = parts_in(self._folder)
        # The last one of a process that was killed may have no tables yet.
        if parts and not parts[-1].is_prepared():
            parts.pop()
        if parts and not parts[-1].is_closed():
            return AuditWriter(parts[-1].path, GENESIS)
        start = parts[-1].end() if parts else GENESIS
        return AuditWriter(self._folder / f"{start.number + 1:012}.sqlite", start)


def audit_page(
    folder: Path, *, limit: int, before: int | None = None, owner: str | None = None
) -> list[AuditEntry]:
    """Read entries from the newest to the oldest; archived files are not looked at.

    Parameters
    ----------
    folder : Path
        Of the log's files.
    limit : int
    before : int, optional
        Only those with a smaller number.
    owner : str, optional
        Only those of this owner.
    """
    entries: list[AuditEntry] = []
    for part in reversed(parts_in(folder)):
        if before is not None and first_number(part) >= before:
            continue
        try:
            entries += part.page(limit=limit - len(entries), before=before, owner=owner)
        except StoreError:
            # Archived since the files were listed.
            if part.path.exists():
                raise
        if len(entries) == limit:
            break
    return entries


def audit_folder(data_dir: Path) -> Path:
    """Where the files of a data folder's audit log lie."""
    return data_dir / "access" / "audit"


def parts_in(folder: Path) -> list[AuditPart]:
    """List the files of a log, the oldest first."""
    return [AuditPart(path) for path in sorted(folder.glob("[0-9]*.sqlite"))]


def head_of(folder: Path) -> Place:
    """Place of the last entry of a log; before the first where there is none."""
    parts = parts_in(folder)
    # The last one of a process that was killed may have no tables yet.
    if parts and not parts[-1].is_prepared():
        parts.pop()
    return parts[-1].end() if parts else GENESIS


def first_number(part: AuditPart) -> int:
    """Tell the number of a file's first entry, by its name."""
    return int(part.path.stem)
