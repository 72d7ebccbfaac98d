"""A client of the modalmotion service: the table of its calls, each a method (see `call`)."""

# Methods without a body are filled in by `call`.
# mypy: disable-error-code="empty-body"

from __future__ import annotations

import io
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from modalmotion.client.bodies import Option, Source, body_of, json_body, plain, segment
from modalmotion.client.calls import (
    Caller,
    Job,
    JobStatus,
    Share,
    awaited,
    call,
    parted,
    posted,
    sequence_of,
    signature_call,
    signature_of,
)
from modalmotion.client.connection import MOST_BYTES, Answer, Call, Connection, Retries
from modalmotion.client.errors import RemoteError, UnreachableError, understood
from modalmotion.client.values import (
    HDF5,
    JSON,
    NPZ,
    POSTED,
    STREAM,
    ZIP,
    CompressedSequence,
    Info,
    SignatureArrays,
    TemplateModes,
    form_of,
    info_of,
    pack_of,
    require_place,
    write,
)
from modalmotion.errors import ShapeError
from modalmotion.mesh import Facts
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.progress import Progress
from modalmotion.signature.distance import Comparison
from modalmotion.signature.making import ModalSignature

if TYPE_CHECKING:
    import httpx2

    from modalmotion.classification import FeatureTable
    from modalmotion.tracking import Track

Case = str | Mapping[str, Any]
"""The id of a stored sequence, or its id, label, subject and covariates."""

Recording = Source | Info | Sequence[Any]
"""Source of a track: a file by its path or as its bytes, images that were sent before, or a cloud
(n, 3) for each frame."""

# Signatures a request, until the service states its limit.
_AT_ONCE: Final = 1000


class Client(Caller):
    """A service: use it in a `with` block, or close it.

    Threads may share one. Options of a call are those of the service, by its names; a call
    waits for its result, whether the service computes it at once or in a job. `progress` is
    called with the bytes of an upload sent so far and those to send in all, or with the share of a
    job that is done.

    Parameters
    ----------
    base_url : str
        Such as http://127.0.0.1:8000.
    key : str, optional
        API key.
    timeout : float, s
        For connecting, and for each pause within a request or an answer.
    retries : Retries, optional
        How often a repeatable request is sent, and how long a call may take in all.
    transport : httpx2.BaseTransport, optional
        In place of the network, such as an application in the same process.
    most_bytes : int
        Largest answer, unpacked; longer ones are not read to their end.

    Raises
    ------
    ParameterError
        If the address or the key is invalid.

    Examples
    --------
    >>> with Client("http://127.0.0.1:8000") as client:  # doctest: +SKIP
    ...     beat = client.upload("beat.npz")
    ...     client.signature(beat.id, modes=7).amplitudes.shape
    (25, 7, 3)
    """

    def __init__(
        self,
        base_url: str,
        key: str | None = None,
        *,
        timeout: float = 60.0,
        retries: Retries | None = None,
        transport: httpx2.BaseTransport | None = None,
        sleep: Callable[[float], None] = time.sleep,
        most_bytes: int = MOST_BYTES,
    ) -> None:
        schedule = Retries() if retries is None else retries
        super().__init__(Connection(base_url, key, timeout, schedule, transport, sleep, most_bytes))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._connection.close()

    # The service itself.

    def is_ready(self) -> bool:
        """Whether the service answers and can store results."""
        try:
            self._get("/health/ready")
        except (RemoteError, UnreachableError):
            return False
        return True

    @call("GET /v1/limits")
    def limits(self) -> Info:
        """Return the limits of the service, by the names that its errors use."""

    @call("GET /v1/jobs")
    def jobs(self, *, state: str | None = None, page: int = 100) -> Iterator[JobStatus]:
        """List jobs from the newest to the oldest, fetched a page at a time."""

    def job(self, job_id: str, accept: str = "*/*") -> Job[Answer]:
        """Return a job by its id; its result is the unparsed answer to its link."""
        status = JobStatus.of(self._get(f"/v1/jobs/{segment(job_id)}").json)
        return Job(self._connection, status, lambda answer: answer, accept)

    @call("GET /v1/audit")
    def audit(self, *, owner: str | None = None, page: int = 100) -> Iterator[Info]:
        """List who did what, of all owners, from the newest to the oldest; needs `admin`."""

    def request(
        self, method: str, path: str, *, json: Any = None, accept: str = JSON, **query: Option
    ) -> Answer:
        """Send any request, such as one without a method here, and wait for what it starts.

        Parameters
        ----------
        method, path : str
        json : JSON value, optional
            The body.
        accept : str
            Media type of the answer.
        **query
            Options.

        Raises
        ------
        ParameterError
            If the path does not begin with a slash.
        RemoteError
            If the service answers with a problem.
        UnreachableError
            If no answer comes. A POST is not sent again by itself.
        """
        body = None if json is None else json_body(json)
        return self._awaited(Call(method, path, query, accept, body), lambda answer: answer)

    # Sequences.

    @call("POST /v1/sequences", is_keyed=True)
    def upload(
        self, source: Source, *, progress: Progress | None = None, **options: Option
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

    def upload_arrays(
        self,
        vertices: Any,
        faces: Any = None,
        *,
        subject: str | None = None,
        label: str | None = None,
        progress: Progress | None = None,
        **stated: Any,
    ) -> Info:
        """Send a sequence from arrays, which are checked before anything is sent.

        Parameters
        ----------
        vertices : (frames, vertices, 3) array_like, in `unit`
        faces : (faces, 3) array_like of int, optional
        subject, label : str, optional
        progress : callable, optional
        **stated
            grid, topology, times, unit, facts, as for `mesh_sequence`.

        Raises
        ------
        InputError
            As `mesh_sequence` does.
        """
        sequence = mesh_sequence(vertices, faces, **stated)
        return self.upload(sequence, progress=progress, subject=subject, label=label)

    @call("POST /v1/sequences", is_keyed=True)
    def start_upload(
        self, source: Source, *, progress: Progress | None = None, **options: Option
    ) -> Job[Info]:
        """Send a sequence, and let a job of the service read it."""

    @call("GET /v1/sequences")
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

    @call("GET /v1/sequences/{sequence_id}")
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
        return info_of(self._connection.send(Call("PATCH", path, body=json_body(changes))))

    @call("DELETE /v1/sequences/{sequence_id}")
    def delete(self, sequence_id: str) -> None:
        """Delete a sequence with everything derived from it, its track too."""

    # Signatures.

    def signature(
        self, sequence_id: str, *, progress: Share | None = None, **options: Option
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
            asked = signature_call(sequence_id, options, HDF5)
            return self._awaited(asked, signature_of, progress)
        return signature_of(self._get(f"/v1/sequences/{segment(sequence_id)}/signature", HDF5))

    @call("POST /v1/sequences/{sequence_id}/signatures", HDF5)
    def start_signature(self, sequence_id: str, **options: Option) -> Job[ModalSignature]:
        """Fit and store a signature in a job of the service."""

    @call("GET /v1/sequences/{sequence_id}/signatures")
    def stored_signatures(self, sequence_id: str, *, page: int = 100) -> Iterator[Info]:
        """List the stored signatures of a sequence: their keys, parameters and errors."""

    @call("DELETE /v1/signatures/{key}")
    def delete_signature(self, key: str) -> None:
        """Delete a stored signature."""

    @call("POST /v1/signature", HDF5)
    def signature_of(
        self, source: Source, *, progress: Progress | None = None, **options: Option
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
        self, sequence_ids: Iterable[str], *, progress: Share | None = None, **options: Option
    ) -> list[SignatureArrays]:
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
        answers: list[SignatureArrays] = []
        for start in range(0, len(ids), at_once):
            request = {"ids": ids[start : start + at_once], **options}
            answers += self._awaited(posted("/v1/signatures/query", request, NPZ), pack_of)
            if progress is not None:
                progress(len(answers) / len(ids))
        return answers

    @call("GET /v1/signatures/{signature}/reconstruction", NPZ)
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
        own, rest = parted(options)
        query = {**rest, "to": self._key(to, own)}
        path = f"/v1/signatures/{self._key(sequence_id, own)}/distance"
        found = self._awaited(Call("GET", path, query), info_of)
        with understood("a distance"):
            by_errors = found["by_errors"]
            return Comparison(
                float(found["distance"]),
                bool(found["uses_theta_zero"]),
                None if by_errors is None else float(by_errors),
            )

    @call("GET /v1/signatures/{signature}/readouts")
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

    @call("POST /v1/sequences/{sequence_id}/tradeoff")
    def tradeoff(self, sequence_id: str, **options: Option) -> Info:
        """Return the cost and the loss of each choice of modes.

        Parameters
        ----------
        sequence_id : str
        **options
            Of the marked signature; and front_modes, only (components).
        """

    # Classes and models.

    def classify(self, sequence_id: str, **options: Option) -> Info:
        """Ask a model for the class of a stored sequence's motion.

        Parameters
        ----------
        sequence_id : str
        **options
            model, the shipped one by default; coverage.
        """
        path = f"/v1/signatures/{segment(sequence_id)}/classifications"
        asked = posted(path, options)
        # A job's result is the list of all models' answers: of what is kept this one's is asked.
        while (answer := self._connection.send(asked)).status == 202:
            awaited(self._connection, answer, _content, asked.accept)
        return info_of(answer)

    @call("POST /v1/classify")
    def classify_of(
        self, source: Source, *, progress: Progress | None = None, **options: Option
    ) -> Info:
        """Ask a model for the class of a sequence sent along; nothing is stored.

        Parameters
        ----------
        source : path, bytes or MeshSequence
        progress : callable, optional
        **options
            Of reading (format, grid, unit, ...), facts=, and model, coverage.
        """

    @call("GET /v1/signatures/{sequence_id}/classifications")
    def classifications(self, sequence_id: str, *, page: int = 100) -> Iterator[Info]:
        """List the models' answers for a sequence."""

    @call("GET /v1/models")
    def models(self, *, page: int = 100) -> Iterator[Info]:
        """List models by name, each in its newest version, fetched a page at a time."""

    @call("GET /v1/models/{name}")
    def model(self, name: str) -> Info:
        """Describe a model, name or name@version; `card` is its card."""

    @call("POST /v1/models", is_keyed=True, nests=True)
    def train(
        self, name: str, cases: Iterable[Case], *, progress: Share | None = None, **options: Option
    ) -> Info:
        """Train a model on stored sequences: the next version of its name.

        Parameters
        ----------
        name : str
        cases : iterable of str or mapping
            Ids of stored sequences, whose labels, subjects and covariates count; or mappings with
            the members id, label, subject and covariates.
        progress : callable, optional
        **options
            Those of `TrainingOptions`.

        Raises
        ------
        RemoteError
            If the cases cannot be trained on.
        """

    @call("POST /v1/models", is_keyed=True, nests=True)
    def start_training(self, name: str, cases: Iterable[Case], **options: Option) -> Job[Info]:
        """Start a training as `train` does, and do not wait for it."""

    @call("POST /v1/models/{name}/evaluations")
    def evaluate(
        self, name: str, cases: Iterable[Case], *, progress: Share | None = None, **options: Option
    ) -> Info:
        """Test a model, name or name@version, on stored, labelled sequences.

        Parameters
        ----------
        name : str
        cases : iterable of str or mapping
            As for `train`, of subjects that the model was not trained on.
        progress : callable, optional
        **options
            coverage, the level of the class sets; and compare_with, another model: then each figure
            has first, second, difference, low, high and p.

        Returns
        -------
        Info
            accuracy, auc, log_loss, sensitivity, cases (the answer to each) and so on: see `/docs`.
        """

    @call("DELETE /v1/models/{name}")
    def delete_model(self, name: str) -> None:
        """Delete a version of a model, as name@version; its number is never used again."""

    @call("POST /v1/features")
    def features(
        self, cases: Iterable[Case], *, progress: Share | None = None, **options: Option
    ) -> FeatureTable:
        """Return the features of stored sequences.

        Parameters
        ----------
        cases : iterable of str or mapping
            As for `train`.
        progress : callable, optional
        **options
            covariates ("all" or a list), modes, topology, kind, timing, and
            on_error: "leave out" goes on without sequences that do not fit.

        Raises
        ------
        RemoteError
            If the sequences do not compare, or have not the features that are named.
        """

    # Norms.

    @call("POST /v1/norms", is_keyed=True)
    def make_norm(
        self,
        name: str,
        controls: Iterable[Case],
        *,
        progress: Share | None = None,
        **options: Option,
    ) -> Info:
        """Make a norm of stored sequences of people who are taken as usual.

        Parameters
        ----------
        name : str
            Of no other norm.
        controls : iterable of str or mapping
            As for `train`, one of each person.
        progress : callable, optional
        **options
            modes, topology.

        Raises
        ------
        RemoteError
            If no norm can be made of them.
        """

    def norms(self, *, page: int = 100) -> list[str]:
        """List the names of all norms."""
        return [str(one["name"]) for one in self._pages("/v1/norms", {"page": page})]

    @call("GET /v1/norms/{name}")
    def norm(self, name: str) -> Info:
        """Describe a norm."""

    @call("DELETE /v1/norms/{name}")
    def delete_norm(self, name: str) -> None:
        """Delete a norm; its name is free again."""

    @call("POST /v1/norms/{norm}/deviations")
    def deviations(self, sequences: Iterable[Case], norm: str, *, level: float = 0.05) -> Info:
        """Compare stored sequences with the controls of a norm; five or more also as a group.

        Parameters
        ----------
        sequences : iterable of str or mapping
            As for `train`.
        norm : str
        level : float
            Level: share of recordings like the controls that are called a deviation.

        Returns
        -------
        Info
            The members of `modalmotion.norm.CohortDeviation`; `deviations` has those of each.

        Raises
        ------
        RemoteError
            If there are too few controls for the level, or one does not compare.
        """

    # Streams and templates.

    @call("POST /v1/encode", STREAM)
    def encode(
        self, source: Source, *, progress: Progress | None = None, **options: Option
    ) -> CompressedSequence:
        """Compress a sequence at an error you choose; nothing is stored.

        Parameters
        ----------
        source : path, bytes or MeshSequence
        progress : callable, optional
        **options
            One of rms, max_error (length unit of the sequence) and bytes; effort; and how to
            read the file.
        """

    @call("GET /v1/sequences/{sequence_id}/encoded", STREAM)
    def encoded(self, sequence_id: str, **options: Option) -> CompressedSequence:
        """Return a stored sequence as a compressed stream: rms, max_error or bytes; effort."""

    def decode(
        self,
        source: Source,
        *,
        frames: range | None = None,
        vertices: range | None = None,
        progress: Progress | None = None,
    ) -> MeshSequence:
        """Decode a stream.

        Parameters
        ----------
        source : path or bytes
        frames : range, optional
            Without gaps; all frames by default.
        vertices : range, optional
            Without gaps; all vertices by default, else those with the triangles between them.
        progress : callable, optional
        """
        ends = {} if frames is None else {"first": frames.start, "stop": frames.stop}
        if vertices is not None:
            ends |= {"first_vertex": vertices.start, "stop_vertex": vertices.stop}
        asked = Call("POST", "/v1/decode", ends, NPZ, body_of(source), is_repeatable=True)
        return self._awaited(asked, sequence_of, progress, is_upload=True)

    @call("POST /v1/templates")
    def make_template(
        self, source: Source, *, progress: Progress | None = None, **options: Option
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

    @call("GET /v1/templates/{template_id}")
    def template(self, template_id: str) -> Info:
        """Describe a template."""

    @call("GET /v1/templates/{template_id}/modes", NPZ)
    def template_modes(self, template_id: str, modes: int = 7, **options: Option) -> TemplateModes:
        """Return labels, angular frequencies and shapes of the vibration modes of a surface.

        Parameters
        ----------
        template_id : str
        modes : int
            How many; no pair is split.
        **options
            wave_speed, in length units per s: 1 by default.
        """

    @call("DELETE /v1/templates/{template_id}")
    def delete_template(self, template_id: str) -> None:
        """Delete a template; signatures that were fitted on it stay."""

    # Images and tracks.

    @call("POST /v1/images", is_keyed=True)
    def upload_images(self, source: Source, *, progress: Progress | None = None) -> Info:
        """Send images to be tracked: `make_track(images)` does, and deletes them.

        Parameters
        ----------
        source : path or bytes
            NIfTI, NRRD, MetaImage, or a zip of DICOM slices or of such files.
        progress : callable, optional

        Raises
        ------
        RemoteError
            If they cannot be read; names limit and remedy.
        UnreachableError
            If no answer comes. Sent again, they are stored once.
        """

    @call("GET /v1/images")
    def all_images(self, *, page: int = 100) -> Iterator[Info]:
        """List images from the newest to the oldest, fetched a page at a time."""

    @call("GET /v1/images/{images_id}")
    def images(self, images_id: str) -> Info:
        """Describe images.

        Raises
        ------
        NotFoundError
            If there are none of that id: they are deleted after tracking, where nobody keeps them.
        """

    @call("DELETE /v1/images/{images_id}")
    def delete_images(self, images_id: str) -> None:
        """Delete images; tracks that were made of them stay."""

    def make_track(
        self, source: Recording, *, progress: Share | None = None, **options: Option
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
            As the service names them: modes, tolerance, time, reference, start, topology,
            contours, unit, times, frame_interval, subject, label, and facts; of images keep,
            papillary, labels and wall. `landmarks`: apex and base by name, (3,) in the reference
            frame, or (frames, 3) with NaN where it is unknown.

        Raises
        ------
        RemoteError
            If it cannot be tracked; names frame, vertex, limit and remedy.
        UnreachableError
            If no answer comes. Sent again, it is stored once.
        """
        return self._awaited(track_call(source, options), self._tracked, progress)

    def start_track(self, source: Recording, **options: Option) -> Job[Track]:
        """Track in a job of the service."""
        return self._started(track_call(source, options), self._tracked)

    @call("GET /v1/tracks/{track_id}", HDF5)
    def track(self, track_id: str) -> Track:
        """Return a stored track: the library's own, bit for bit.

        Raises
        ------
        NotFoundError
            If no track has that id, which is that of its sequence.
        """

    # Files.

    def save(self, what: str, path: str | Path, name: Any = None, **options: Option) -> None:
        """Write an answer to a file, in the format of its suffix.

        Parameters
        ----------
        what : str
            signature (.h5, .npz, .png, .csv, .json), readouts (.png, .csv, .json), strain (.json),
            reconstruction (.npz, .vtkhdf, .glb, .zip of PLY), report (.pdf, .json as FHIR, .csv),
            view (.html), tradeoff (.png, .json), stream (.mms) of a stored sequence; template
            (.png, .json) and its modes (.png, .npz, .h5); track (.h5, .png, .json); model (.h5,
            .png, .csv, .md) and its evaluation (.png, .csv); norm (.h5); features (.csv, .json).
        path : str or Path
        name : str, optional
            Id of the sequence or the template, key of a signature, name of the model or the norm.
        **options
            As of the call that returns it; `sequences` for an evaluation and features.

        Raises
        ------
        ParameterError
            If there is no such thing or form.
        StoreError
            If the file cannot be written.
        """
        target = Path(path)
        place, media_type = form_of(what, target)
        if place.startswith("/v1/signatures/"):
            own, options = parted(options)
            name = self._key(str(name), own)
        if "{}" in place:
            place = place.format(segment(str(name)))
        if what in POSTED:
            asked = posted(place, options, media_type)
        else:
            asked = Call("GET", place, options, media_type)
        write(self._awaited(asked, _content), target)

    def save_dicom(
        self, sequence_id: str, study: bytes | Path, path: str | Path, **options: Option
    ) -> None:
        """Write a zip of DICOM objects of a patient's study: a structured report and surfaces.

        Parameters
        ----------
        sequence_id : str
        study : bytes or Path
            Any instance of the study.
        path : str or Path
        **options
            Of the signature; and model, whose kept classification is reported.

        Raises
        ------
        RemoteError
            If the sequence's coordinates are not stated to be LPS, in mm.
        """
        target = Path(path)
        require_place(target)
        own, rest = parted(options)
        place = f"/v1/signatures/{self._key(sequence_id, own)}/dicom"
        asked = Call("POST", place, rest, ZIP, body_of(study), is_repeatable=True)
        write(self._awaited(asked, _content), target)

    def save_tracked_report(
        self,
        source: Recording,
        path: str | Path,
        *,
        progress: Share | None = None,
        **options: Option,
    ) -> None:
        """Track a surface through images, points or contours, and write a zip of its report.

        It has the report for people, for systems and for statistics, and a page to look at. The
        track and the class are stored.

        Parameters
        ----------
        source : as for `make_track`
        path : str or Path
        progress : callable, optional
        **options
            model; and those of `make_track`.

        Raises
        ------
        RemoteError
            If it cannot be tracked.
        """
        target = Path(path)
        require_place(target)
        asked = replace(track_call(source, {**options, "report": True}), accept=ZIP)
        write(self._awaited(asked, _content, progress), target)

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


def _content(answer: Answer) -> bytes:
    return answer.content
