"""Images and tracks of one owner: taken in by a worker, stored, shown, forgotten."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path

from modalmotion.errors import NotFoundError
from modalmotion.progress import StageReport
from modalmotion.store import ImagesRecord, ResultStore, SequenceRecord
from modalmotion.store.index import to_text
from modalmotion.tracking.parameters import TrackParameters
from modalmotion_service.http.observation import add_milliseconds, stage
from modalmotion_service.schemas.queries import TrackView
from modalmotion_service.schemas.sequences import TrackAnswer, TrackEstimate
from modalmotion_service.work.tasks import tracks
from modalmotion_service.work.tasks.tracks import ingest_images, show_slices
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.background import for_ever
from modalmotion_service.workspace.jobs import IdempotencyKeys, Job, Jobs, gone, results_of
from modalmotion_service.workspace.owner_work import SharedWork, unheard
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


@dataclass(frozen=True)
class KeptTrack:
    """A track that is stored.

    Parameters
    ----------
    record : SequenceRecord
        Of its sequence.
    estimate : TrackEstimate
    is_new : bool
    filled : tuple of str
        Facts of a known sequence that were not known before.
    """

    record: SequenceRecord
    estimate: TrackEstimate
    is_new: bool
    filled: tuple[str, ...]


class Tracks:
    """Makes and shows tracks.

    Parameters
    ----------
    store : ResultStore
    analysis : Analysis
        Its workers read uploads and track.
    images : Images
        That are tracked, and then forgotten or kept.
    """

    def __init__(self, store: ResultStore, analysis: Analysis, images: Images) -> None:
        self._store = store
        self._analysis = analysis
        self._images = images
        self._shared_work = SharedWork()

    async def keep(
        self,
        sent: Upload | str,
        parameters: TrackParameters,
        start: str | None,
        *,
        subject: str | None,
        label: str | None,
        report: StageReport = unheard,
    ) -> KeptTrack:
        """Track a surface through an upload or images, and store the track and its sequence.

        Parameters
        ----------
        sent : Upload or str
            Or the id of images, which stay: `settle` is for who has told of the track.
        parameters : TrackParameters
        start : str or None
            Id of a stored sequence whose first surface is started from.
        subject, label : str or None
        report : callable

        Raises
        ------
        NotFoundError
            If the start is not there, or the images are not.
        ConflictError
            If the sequence is known, and something that is stated is known to be otherwise.
        """

        async def make(tell: StageReport) -> KeptTrack:
            surface = await self.start_path(start)
            source: Upload | Path
            if isinstance(sent, str):
                source = await asyncio.to_thread(self._store.images_path, sent)
            else:
                source = sent
            with self._analysis.image() as sequence, self._analysis.image() as track:
                with stage("worker"):
                    found, estimate, milliseconds = await self._analysis.followed(
                        tell, tracks.follow, source, parameters, surface, sequence, track
                    )
                    add_milliseconds(milliseconds)
                with stage("store"):
                    record, is_new = await asyncio.to_thread(
                        self._store.put_track_images,
                        *(sequence, track, found),
                        subject=subject,
                        label=label,
                    )
            # Of a sequence that was there before, by itself or with this track.
            stated = parameters.facts
            record, filled = await asyncio.to_thread(
                self._analysis.completed, record.id, subject, label, stated, found.facts
            )
            return KeptTrack(record, estimate, is_new, filled)

        # Images are tracked once for each request, for it may ask for something else.
        key = object() if isinstance(sent, str) else sent.path
        return await self._shared_work.join(key, make, report)

    async def settle(self, images_id: str | None, track_id: str, *, is_kept: bool) -> None:
        """Keep the images of a track for its pictures, or delete them.

        Once nothing needs them any more: a job that is done again after a crash starts from them.
        """
        if images_id is not None:
            await asyncio.to_thread(self._images.after_track, images_id, track_id, is_kept=is_kept)

    async def start_path(self, start: str | None) -> Path | None:
        """File of the sequence that is started from.

        Raises
        ------
        NotFoundError
            If it is not there, or its vertices were not kept.
        """
        if start is None:
            return None
        return await asyncio.to_thread(self._store.sequence_path, start)

    async def describe(self, track_id: str) -> TrackAnswer:
        """Describe a stored track."""
        path = await asyncio.to_thread(self._store.track_path, track_id)
        estimate = await self._analysis.work(tracks.describe_track, path)
        images_id = await asyncio.to_thread(self._store.images_id_of_track, track_id)
        return TrackAnswer.joined(estimate, self._store.track_record(track_id), images_id)

    async def as_hdf5(self, track_id: str) -> bytes:
        """Give a stored track with the facts of its sequence as HDF5."""
        path = await asyncio.to_thread(self._store.track_path, track_id)
        facts = self._store.track_record(track_id).facts
        return await self._analysis.work(tracks.track_with_facts, path, facts)

    async def data(self, track_id: str) -> bytes:
        """Give the data of a stored track, as the page draws them over its surface."""
        path = await asyncio.to_thread(self._store.track_path, track_id)
        return await self._analysis.work(tracks.show_data, path)

    async def draw(self, track_id: str, query: TrackView) -> bytes:
        """Draw a stored track, as PNG."""
        path = await asyncio.to_thread(self._store.track_path, track_id)
        with stage("draw"):
            if query.picture == "overlay":
                images = await asyncio.to_thread(self._store.images_of_track, track_id)
                return await self._analysis.work(tracks.draw_overlay, path, images)
            return await self._analysis.work(tracks.draw_track, path, query.picture, query.frame)
