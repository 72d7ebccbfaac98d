"""Uploads: each is read by a worker, and its sequence stored."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Final

from modalmotion.errors import ParameterError
from modalmotion.facts import Facts
from modalmotion.stopwatch import StageReport
from modalmotion.store import SequenceRecord
from modalmotion_service.errors import ConflictError
from modalmotion_service.http.timing import add_milliseconds, stage
from modalmotion_service.schemas import ReadingAnswer
from modalmotion_service.work.tasks import sequences
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.owner_work import OwnerWork
from modalmotion_service.workspace.shared_work import unheard

SAMPLE: Final = "Sample heart (simulated)"
"""Name of the simulated heart."""


@dataclass(frozen=True)
class KeptUpload:
    """An upload whose sequence is stored.

    Parameters
    ----------
    record : SequenceRecord
    reading : ReadingAnswer
        How the upload was read.
    is_new : bool
    filled : tuple of str
        Facts of a known sequence that were not known before.
    """

    record: SequenceRecord
    reading: ReadingAnswer
    is_new: bool
    filled: tuple[str, ...] = ()


class UploadWork(OwnerWork):
    """Reads uploads and keeps their sequences."""

    async def keep(
        self,
        upload: Upload,
        *,
        subject: str | None,
        label: str | None,
        report: StageReport = unheard,
    ) -> KeptUpload:
        """Read an upload and store its sequence.

        Of a known sequence, what is stated with it and not known yet is filled in.

        Raises
        ------
        ConflictError
            If something is stated beside the file that is known to be otherwise.
        """

        async def make(tell: StageReport) -> KeptUpload:
            with self.image() as image, stage("worker"):
                work = self.followed(tell, sequences.ingest, upload, image)
                sent, reading, milliseconds = await work
                add_milliseconds(milliseconds)
                with stage("store"):
                    record, is_new = await asyncio.to_thread(
                        self._store.put_sequence_image, image, sent, subject=subject, label=label
                    )
            filled: tuple[str, ...] = ()
            if not is_new:
                record, filled = await asyncio.to_thread(
                    self.completed, record.id, subject, label, upload.options.facts, sent.facts
                )
                if filled:
                    reading.notes.append(
                        f"The sequence was known; {', '.join(filled)} is known now too."
                    )
            others = [n for n in sent.facts.stated if n in record.facts.changed(sent.facts)]
            if others:
                reading.notes.append(
                    f"The sequence was known, and keeps its facts; {', '.join(others)} would now "
                    "be different. PATCH changes them."
                )
            return KeptUpload(record, reading, is_new, filled)

        return await self._shared_work.join(upload.path, make, report)

    async def sample(self) -> SequenceRecord:
        """Store a simulated heart, for who has none at hand."""
        with self.image() as image, stage("worker"):
            made = await self.work(sequences.sample, image)
            record, is_new = await asyncio.to_thread(self._store.put_sequence_image, image, made)
        if not is_new:
            return record
        return await asyncio.to_thread(self._store.update_sequence, record.id, name=SAMPLE)

    def completed(
        self,
        sequence_id: str,
        subject: str | None,
        label: str | None,
        facts: Facts,
        offered: Facts,
    ) -> tuple[SequenceRecord, tuple[str, ...]]:
        """Fill in what is not known of a stored sequence; gives the names of that too.

        Raises
        ------
        ConflictError
            If something is known to be otherwise.
        """
        try:
            return self._store.complete_sequence(
                sequence_id, subject=subject, label=label, facts=facts, offered=offered
            )
        except ParameterError as error:
            if "differ" not in error.details:
                raise
            raise ConflictError(
                error.message,
                remedy=f"Change it with PATCH /v1/sequences/{sequence_id}, or leave it out.",
                details={**error.details, "sequence_id": sequence_id},
            ) from error
