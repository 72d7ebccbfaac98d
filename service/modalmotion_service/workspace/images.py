"""Images of one owner: taken in by a worker, held until they are tracked, forgotten."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from functools import partial

from modalmotion.errors import NotFoundError
from modalmotion.progress import StageReport
from modalmotion.store import ImagesRecord, ResultStore
from modalmotion.store.index.cursor import to_text
from modalmotion_service.http.timing import add_milliseconds, stage
from modalmotion_service.work.tasks.images import ingest_images, show_slices
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.gone import gone
from modalmotion_service.workspace.idempotency import IdempotencyKeys
from modalmotion_service.workspace.jobs import Job, Jobs, results_of
from modalmotion_service.workspace.perseverance import for_ever
from modalmotion_service.workspace.shared_work import SharedWork, unheard
from modalmotion_service.workspace.spool import Spool, SpoolFile


def link_of(images_id: str) -> str:
    """Path of images."""
    return f"/v1/images/{images_id}"


class Images:
    """Takes images in, and forgets them.

    Parameters
    ----------
    store : ResultStore
    analysis : Analysis
        Its workers read them.
    jobs : Jobs
    keys : IdempotencyKeys
        Both mention images until they are forgotten.
    spool : Spool
        Holds what jobs have made of them.
    """

    def __init__(
        self,
        store: ResultStore,
        analysis: Analysis,
        jobs: Jobs,
        keys: IdempotencyKeys,
        spool: Spool,
    ) -> None:
        self._store = store
        self._analysis = analysis
        self._jobs = jobs
        self._keys = keys
        self._spool = spool
        self._shared_work = SharedWork()

    async def take(
        self, upload: Upload, report: StageReport = unheard
    ) -> tuple[ImagesRecord, bool]:
        """Read images and store them; tells whether they are new."""

        async def make(tell: StageReport) -> tuple[ImagesRecord, bool]:
            with self._analysis.image() as file:
                with stage("worker"):
                    sent, milliseconds = await self._analysis.followed(
                        tell, ingest_images, upload, file
                    )
                    add_milliseconds(milliseconds)
                with stage("store"):
                    await asyncio.to_thread(SpoolFile(file).make_durable)
                    return await asyncio.to_thread(self._store.put_images, file, sent)

        return await self._shared_work.join(upload.path, make, report)

    async def slices(self, images_id: str, frame: int, track_id: str | None) -> bytes:
        """Give the slices of one frame, as the page reads them, and a track's surface in it."""
        path = await asyncio.to_thread(self._store.images_path, images_id)
        track = None
        if track_id is not None:
            track = await asyncio.to_thread(self._store.track_path, track_id)
        with stage("view"):
            return await self._analysis.work(show_slices, path, frame, track)

    def about(self, images_id: str) -> tuple[Job, ...]:
        """List the jobs that read images, or have stored them."""
        return self._jobs.about(images_id, link_of(images_id))

    def forget(self, images_id: str) -> None:
        """Delete images, with every mention of them by jobs that are finished and stored answers.

        Raises
        ------
        NotFoundError
            If there are none of that id.
        StoreError
            If they cannot be deleted, or not wholly; then they can be deleted again.
        """
        self._keys.replace_answers(link_of(images_id), *gone())
        # Not the one that was begun with them and is about to succeed: its result is its own.
        about = [job for job in self.about(images_id) if job.is_finished]
        # Slices that nobody has fetched are the images as well.
        for name in results_of(about):
            self._spool.remove(name)
        self._jobs.forget(*(job.id for job in about))
        self._store.delete_images(images_id)

    def after_track(self, images_id: str, track_id: str, *, is_kept: bool) -> None:
        """Keep images that were tracked on purpose, or forget them."""
        # Deleted meanwhile, by their owner or by another track.
        with contextlib.suppress(NotFoundError):
            if is_kept:
                self._store.keep_images(images_id, track_id)
            elif not self._store.images_record(images_id).is_kept:
                self.forget(images_id)

    def sweep(self, age: timedelta) -> Sequence[str]:
        """Forget images that nobody has tracked for so long; gives their ids."""
        past = to_text((datetime.now(UTC) - age).timestamp())
        old = self._store.untracked_images(past)
        for images_id in old:
            with contextlib.suppress(NotFoundError):
                self.forget(images_id)
        return old

    async def sweep_for_ever(self, age: timedelta) -> None:
        """Sweep now and again, at least every hour."""
        seconds = min(3600.0, age.total_seconds() / 4)
        await for_ever("images", partial(asyncio.to_thread, self.sweep, age), seconds)
