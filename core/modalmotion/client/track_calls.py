"""Tracks: surfaces followed through clouds, contours and changing meshes."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from modalmotion.client.answers import ImagesInfo, SequenceInfo, value_of
from modalmotion.client.bodies import Source, body_of
from modalmotion.client.calls import HDF5, PNG, Calls, require_place, save
from modalmotion.client.connection import Answer, Call
from modalmotion.client.errors import understood
from modalmotion.client.jobs import Job
from modalmotion.client.query import Option, segment
from modalmotion.errors import ShapeError
from modalmotion.tracking import Track
from modalmotion.tracking.hdf5 import track_from_hdf5

Recording = Source | ImagesInfo | Sequence[Any]
"""Source of a track: a file by its path or as its bytes, images that were sent before, or a cloud
(n, 3) for each frame."""


class TrackCalls(Calls):
    """Tracks: surfaces followed through clouds, contours and changing meshes."""

    def make_track(
        self,
        source: Recording,
        *,
        landmarks: Mapping[str, Any] | None = None,
        progress: Callable[[float], None] | None = None,
        **options: Option,
    ) -> Track:
        """Track a surface through a recording, and store it with the sequence that it makes.

        Parameters
        ----------
        source : path, bytes, ImagesInfo or sequence of (n, 3) array_like
            A zip of one mesh, cloud or set of contours a frame, images, or an npz of points and
            offsets; images as `upload_images` returns them, which are deleted once they are tracked
            (keep=True keeps them); or the points of each frame, none where it is missing.
        landmarks : mapping of "apex" and "base" to (3,) or (frames, 3) array_like, optional
            A place in the reference frame, or one for each frame with NaN where it is unknown.
        progress : callable, optional
            Called with the share that is done where a job of the service tracks.
        **options
            As the service names them: modes, tolerance, time, reference, start, topology,
            contours, unit, times, frame_interval, subject, label, and facts; of images keep,
            papillary, labels and wall.

        Raises
        ------
        RemoteError
            If it cannot be tracked; names frame, vertex, limit and remedy.
        UnreachableError
            If no answer comes. Sent again, it is stored once.
        """
        return self._awaited(_track(source, landmarks, options), self._made, progress)

    def start_track(
        self, source: Recording, *, landmarks: Mapping[str, Any] | None = None, **options: Option
    ) -> Job[Track]:
        """Track in a job of the service."""
        return self._started(_track(source, landmarks, options), self._made)

    def track(self, track_id: str) -> Track:
        """Return a stored track: the library's own, bit for bit.

        Raises
        ------
        NotFoundError
            If no track has that id, which is that of its sequence.
        """
        return track_from_hdf5(self._get(_path(track_id), accept=HDF5).content)

    def tracks(
        self, *, subject: str | None = None, label: str | None = None, page: int = 100
    ) -> Iterator[SequenceInfo]:
        """List tracked sequences from the newest to the oldest, fetched a page at a time."""
        members = self._pages("/v1/tracks", "tracks", subject=subject, label=label, limit=page)
        return (value_of(SequenceInfo, member["sequence"]) for member in members)

    def save_track_picture(self, track_id: str, path: str | Path, **options: Option) -> None:
        """Write a picture of a track, as PNG.

        Parameters
        ----------
        track_id : str
        path : str or Path
        **options
            picture: deviations (the stated error on the surface, in a `frame`), determined, or
            overlay (contours over images that were kept).
        """
        target = Path(path)
        require_place(target)
        save(self._get(_path(track_id), options, PNG).content, target)

    def delete_track(self, track_id: str) -> None:
        """Delete a track with its sequence and everything derived from it."""
        self._connection.send(Call("DELETE", _path(track_id)))

    def _made(self, answer: Answer) -> Track:
        with understood("a track"):
            track_id = str(answer.json["id"])
        return self.track(track_id)


def _track(
    source: Recording, landmarks: Mapping[str, Any] | None, options: dict[str, Option]
) -> Call:
    query: dict[str, Any] = dict(options)
    if landmarks is not None:
        query["landmarks"] = {name: _places(value) for name, value in landmarks.items()}
    if isinstance(source, ImagesInfo):
        return Call("POST", "/v1/tracks", {**query, "images": source.id}, is_keyed=True)
    if isinstance(source, Sequence) and not isinstance(source, str | bytes | bytearray):
        source = _as_npz(source)
    return Call("POST", "/v1/tracks", query, body=body_of(source), is_keyed=True)


def _places(value: Any) -> list[Any]:
    places = np.asarray(value, dtype=np.float64)
    if places.ndim == 1:
        return list(places.tolist())
    return [row.tolist() if np.isfinite(row).all() else None for row in places]


def _as_npz(clouds: Sequence[Any]) -> bytes:
    none = np.zeros((0, 3))
    frames = [none if cloud is None else np.asarray(cloud) for cloud in clouds]
    for k, frame in enumerate(frames):
        if frame.ndim != 2 or frame.shape[1] != 3 or frame.dtype.kind not in "fiu":
            raise ShapeError(
                f"Frame {k} has the shape {frame.shape} of {frame.dtype}, not (n, 3) numbers.",
                remedy="Give the points of each frame, or None; send meshes as a zip of files.",
                frame=k,
            )
    buffer = io.BytesIO()
    offsets = np.cumsum([0, *map(len, frames)], dtype=np.int64)
    np.savez(buffer, points=np.concatenate([none, *frames]), offsets=offsets)
    return buffer.getvalue()


def _path(track_id: str) -> str:
    return f"/v1/tracks/{segment(track_id)}"
