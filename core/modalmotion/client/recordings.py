"""Calls about recordings: sequences, signatures, streams, templates, images and tracks."""

# Methods without a body are filled in by `call`.
# mypy: disable-error-code="empty-body"

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from modalmotion.client import calls
from modalmotion.client.connection import (
    Answer,
    Call,
    Option,
    Source,
    body_of,
    json_body,
    plain,
    segment,
)
from modalmotion.client.errors import understood
from modalmotion.client.values import (
    HDF5,
    NPZ,
    STREAM,
    Info,
    info_of,
    pack_of,
)
from modalmotion.errors import ShapeError
from modalmotion.mesh import Facts
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Progress, Reporter
from modalmotion.signature.distance import Comparison
from modalmotion.signature.making import ModalSignature

if TYPE_CHECKING:
    from modalmotion.tracking import Track

Recording = Source | Info | Sequence[Any]
"""Source of a track: a file by its path or as its bytes, images that were sent before, or a cloud
(n, 3) for each frame."""

# Signatures a request, until the service states its limit.
_AT_ONCE: Final = 1000


class Recordings(calls.Caller):
    """The part of `Client` about recordings and what is made of them."""

    @calls.call("GET /v1/limits")
    def limits(self) -> Info:
        """Return the limits of the service, by the names that its errors use."""

    # Sequences.

    @calls.call("POST /v1/sequences", is_keyed=True)
    def upload(
        self, source: Source, *, progress: Reporter | None = None, **options: Option
    ) -> Info:
        """Send a sequence, and wait until it is stored.

        A sequence that the service already has is not stored twice: its id is the same.

        Parameters
        ----------
        source : path, bytes or MeshSequence
            A file of any format the service reads, by its path or as its bytes; or a sequence.
            Files and arrays are sent a piece at a time.
        progress : callable, optional
        **options
            As the service names them: subject, label, topology, grid, unit, times, format, ...;
            and `facts`, or each by its name: tracking, period, ...

        Raises
        ------
        RemoteError
            If it cannot be used; names frame, vertex, limit and remedy.
        UnreachableError
            If no answer comes. Sent again, it is stored once.
        """

    @calls.call("POST /v1/sequences", is_keyed=True)
    def start_upload(
        self, source: Source, *, progress: Reporter | None = None, **options: Option
    ) -> calls.Job[Info]:
        """Send a sequence, and let a job of the service read it."""

    @calls.call("GET /v1/sequences")
    def sequences(
        self,
        *,
        subject: str | None = None,
        label: str | None = None,
        tracked: bool | None = None,
        page: int = 100,
    ) -> Iterator[Info]:
        """List sequences from the newest to the oldest, fetched a page at a time.

        Parameters
        ----------
        subject, label : str, optional
            Only sequences of that subject, with that label.
        tracked : bool
            Only those that were tracked.
        page : int
            How many are fetched at once.
        """

    @calls.call("GET /v1/sequences/{sequence_id}")
    def sequence(self, sequence_id: str) -> Info:
        """Describe a sequence.

        Raises
        ------
        NotFoundError
            If no sequence has that id.
        """

    def update(self, sequence_id: str, **changes: Option) -> Info:
        """Change what is stated of a sequence; None removes it.

        Parameters
        ----------
        sequence_id : str
        **changes
            subject, label and name; and facts, which replace stored ones. In a mapping of facts
            None makes one unknown, and removes one covariate:
            ``{"period": None, "covariates": {"age": None}}``.
        """
        if isinstance(changes.get("facts"), Facts):
            changes["facts"] = plain({"facts": changes["facts"]})
        path = f"/v1/sequences/{segment(sequence_id)}"
        return info_of(self._send(Call("PATCH", path, body=json_body(changes))))

    @calls.call("DELETE /v1/sequences/{sequence_id}")
    def delete(self, sequence_id: str) -> None:
        """Delete a sequence with everything derived from it, its track too."""

    # Signatures.

    def signature(
        self, sequence_id: str, *, progress: Reporter | None = None, **options: Option
    ) -> ModalSignature:
        """Return the modal signature of a stored sequence: the library's own, bit for bit.

        Parameters
        ----------
        sequence_id : str
        progress : callable, optional
        **options
            Those of `SignatureParameters`, with which it is stored: the same are fitted once.
            Without any, it is the usual one of seven modes, and nothing is stored.

        Raises
        ------
        NotFoundError
            If the sequence does not exist.
        RemoteError
            If the signature cannot be fitted.
        """
        if options:
            asked = calls.signature_call(sequence_id, options, HDF5)
            return self._awaited(asked, calls.signature_of, progress)
        return calls.signature_of(
            self._get(f"/v1/sequences/{segment(sequence_id)}/signature", HDF5)
        )

    @calls.call("POST /v1/sequences/{sequence_id}/signatures", HDF5)
    def start_signature(self, sequence_id: str, **options: Option) -> calls.Job[ModalSignature]:
        """Fit and store a signature in a job of the service."""

    @calls.call("GET /v1/sequences/{sequence_id}/signatures")
    def stored_signatures(self, sequence_id: str, *, page: int = 100) -> Iterator[Info]:
        """List the stored signatures of a sequence: their keys, parameters and errors."""

    @calls.call("DELETE /v1/signatures/{key}")
    def delete_signature(self, key: str) -> None:
        """Delete a stored signature."""

    @calls.call("POST /v1/signature", HDF5)
    def signature_of(
        self, source: Source, *, progress: Reporter | None = None, **options: Option
    ) -> ModalSignature:
        """Return the modal signature of a sequence sent along; nothing is stored.

        Parameters
        ----------
        source : path, bytes or MeshSequence
        progress : callable, optional
        **options
            Of reading (format, grid, unit, ...) and of the signature (modes, template, ...).
        """

    def signatures(
        self, sequence_ids: Iterable[str], *, progress: Reporter | None = None, **options: Option
    ) -> list[Info]:
        """Return the trajectories of many sequences, in the order of their ids.

        Parameters
        ----------
        sequence_ids : iterable of str
            Any number: they are sent in as few requests as the service allows.
        progress : callable, optional
        **options
            Of all the signatures, which are stored.
        """
        ids = list(sequence_ids)
        at_once = _AT_ONCE
        if len(ids) > 1:
            with understood("a list of limits"):
                at_once = max(1, int(self.limits().get("query_ids", _AT_ONCE)))
        answers: list[Info] = []
        for start in range(0, len(ids), at_once):
            request = {"ids": ids[start : start + at_once], **options}
            answers += self._awaited(calls.posted("/v1/signatures/query", request, NPZ), pack_of)
            if progress is not None:
                progress(Progress(len(answers), len(ids)))
        return answers

    @calls.call("GET /v1/signatures/{signature}/reconstruction", NPZ)
    def reconstruction(self, sequence_id: str, **options: Option) -> MeshSequence:
        """Return the surfaces that a signature describes.

        Parameters
        ----------
        sequence_id : str
        **options
            Of the signature; and times, in s, phases, shares of the cycle, or frames, so many in
            even steps: those of the recording by default.
        """

    def distance(self, sequence_id: str, to: str, **options: Option) -> Comparison:
        """Return the distance of a sequence's signature from another's: 0 for the same motion."""
        own, rest = calls.parted(options)
        query = {**rest, "to": self._key(to, own)}
        path = f"/v1/signatures/{self._key(sequence_id, own)}/distance"
        found = self._awaited(Call("GET", path, query), info_of)
        with understood("a distance"):
            return Comparison(**found)

    @calls.call("GET /v1/signatures/{signature}/readouts")
    def readouts(self, sequence_id: str, **options: Option) -> Info:
        """Return volumes, rates and strain over time, each with its bound.

        Parameters
        ----------
        sequence_id : str
        **options
            Of the signature: modes, template, ...

        Raises
        ------
        RemoteError
            If the surface encloses nothing.
        """

    @calls.call("POST /v1/sequences/{sequence_id}/tradeoff")
    def tradeoff(self, sequence_id: str, **options: Option) -> Info:
        """Return the cost and the loss of each choice of modes.

        Parameters
        ----------
        sequence_id : str
        **options
            Of the marked signature; and front_modes, only (components).
        """

    @calls.call("POST /v1/encode", STREAM)
    def encode(
        self, source: Source, *, progress: Reporter | None = None, **options: Option
    ) -> Info:
        """Compress a sequence at an error you choose; nothing is stored.

        Parameters
        ----------
        source : path, bytes or MeshSequence
        progress : callable, optional
        **options
            One of rms, max_error (length unit of the sequence) and bytes; effort; and how to
            read the file.
        """

    @calls.call("GET /v1/sequences/{sequence_id}/encoded", STREAM)
    def encoded(self, sequence_id: str, **options: Option) -> Info:
        """Return a stored sequence as a compressed stream: rms, max_error or bytes; effort."""

    @calls.call("POST /v1/decode", NPZ)
    def decode(
        self, source: Source, *, progress: Reporter | None = None, **options: Option
    ) -> MeshSequence:
        """Decode a stream, or a part of it.

        Parameters
        ----------
        source : path or bytes
        progress : callable, optional
        **options
            first and stop: frames.
        """

    @calls.call("POST /v1/templates")
    def make_template(
        self, source: Source, *, progress: Reporter | None = None, **options: Option
    ) -> Info:
        """Make the template of a sequence's reference frame, and store it.

        Parameters
        ----------
        source : path, bytes or MeshSequence
        progress : callable, optional
        **options
            How to read the file; topology, reference, weights, landmarks, ...
        """

    def templates(self, *, page: int = 100) -> list[str]:
        """List the ids of all templates."""
        return [str(one) for one in self._pages("/v1/templates", {"page": page})]

    @calls.call("GET /v1/templates/{template_id}")
    def template(self, template_id: str) -> Info:
        """Describe a template."""

    @calls.call("GET /v1/templates/{template_id}/modes", NPZ)
    def template_modes(self, template_id: str, modes: int = 7, **options: Option) -> Info:
        """Return labels, angular frequencies and shapes of the vibration modes of a surface.

        Parameters
        ----------
        template_id : str
        modes : int
            How many; no pair is split.
        **options
            wave_speed, in length units per s: 1 by default.
        """

    @calls.call("DELETE /v1/templates/{template_id}")
    def delete_template(self, template_id: str) -> None:
        """Delete a template; signatures that were fitted on it stay."""

    @calls.call("POST /v1/images", is_keyed=True)
    def upload_images(self, source: Source, *, progress: Reporter | None = None) -> Info:
        """Send images to be tracked: `make_track(images)` does, and deletes them.

        Parameters
        ----------
        source : path or bytes
            NIfTI, NRRD, MetaImage, or a zip of DICOM slices or of such files.
        progress : callable, optional
        """

    @calls.call("GET /v1/images")
    def all_images(self, *, page: int = 100) -> Iterator[Info]:
        """List images from the newest to the oldest, fetched a page at a time."""

    @calls.call("GET /v1/images/{images_id}")
    def images(self, images_id: str) -> Info:
        """Describe images.

        Raises
        ------
        NotFoundError
            If there are none of that id: they are deleted after tracking, where nobody keeps them.
        """

    @calls.call("DELETE /v1/images/{images_id}")
    def delete_images(self, images_id: str) -> None:
        """Delete images; tracks that were made of them stay."""

    def make_track(
        self, source: Recording, *, progress: Reporter | None = None, **options: Option
    ) -> Track:
        """Track a surface through a recording, and store it with the sequence that it makes.

        Parameters
        ----------
        source : path, bytes, Info or sequence of (n, 3) array_like
            A zip of one mesh, cloud or set of contours a frame, images, or an npz of points and
            offsets; images as `upload_images` returns them, which are deleted once they are tracked
            (keep=True keeps them); or the points of each frame, none where it is missing.
        progress : callable, optional
        **options
            As the service names them: modes, time, reference, start, topology,
            labels, unit, times, frame_interval, subject, label, and facts; of images keep and
            papillary. `landmarks`: apex and base by name, (3,) in the reference
            frame, or (frames, 3) with NaN where it is unknown.

        Raises
        ------
        RemoteError
            If it cannot be tracked; names frame, vertex, limit and remedy.
        UnreachableError
            If no answer comes. Sent again, it is stored once.
        """
        return self._awaited(track_call(source, options), self._tracked, progress)

    def start_track(self, source: Recording, **options: Option) -> calls.Job[Track]:
        """Track in a job of the service."""
        return self._started(track_call(source, options), self._tracked)

    @calls.call("GET /v1/tracks/{track_id}", HDF5)
    def track(self, track_id: str) -> Track:
        """Return a stored track: the library's own, bit for bit.

        Raises
        ------
        NotFoundError
            If no track has that id, which is that of its sequence.
        """

    def _tracked(self, answer: Answer) -> Track:
        with understood("a track"):
            track_id = str(answer.json["id"])
        return self.track(track_id)


def track_call(source: Recording, options: Mapping[str, Option]) -> Call:
    """Write what is asked of a track.

    Raises
    ------
    ShapeError
        If the points of a frame are none.
    """
    if isinstance(source, Info):
        return Call("POST", "/v1/tracks", {**options, "images": source.id}, is_keyed=True)
    if isinstance(source, Sequence) and not isinstance(source, str | bytes | bytearray):
        source = _as_npz(source)
    return Call("POST", "/v1/tracks", options, body=body_of(source), is_keyed=True)


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
