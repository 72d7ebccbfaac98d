"""A client of the modalmotion service."""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self, TypeVar

import numpy as np

from modalmotion.client.bodies import Source, body_of, form_body, json_body
from modalmotion.client.connection import MOST_BYTES, Answer, Call, Connection
from modalmotion.client.errors import (
    BrokenAnswerError,
    RemoteError,
    UnreachableError,
    understood,
)
from modalmotion.client.files import HDF5, JSON, NPZ, STREAM, ZIP, form_of, require_place, write
from modalmotion.client.jobs import Job, JobStatus, awaited
from modalmotion.client.many_files import (
    SentResult,
    in_requests,
    named_bodies,
    results_in,
    signatures_in,
)
from modalmotion.client.query import Option, plain, segment
from modalmotion.client.retries import Retries
from modalmotion.client.values import (
    CompressedSequence,
    Info,
    SignatureArrays,
    TemplateModes,
    compressed_of,
    info_of,
    pack_of,
    template_modes_of,
)
from modalmotion.errors import ParameterError, ShapeError
from modalmotion.facts import Facts
from modalmotion.formats.npz import read_npz
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.progress import Progress
from modalmotion.signature.comparison import Comparison
from modalmotion.signature.making import ModalSignature, SignatureParameters

if TYPE_CHECKING:
    import httpx2

    from modalmotion.classification import FeatureTable
    from modalmotion.tracking import Track

T = TypeVar("T")
Share = Callable[[float], None]

Case = str | Mapping[str, Any]
"""The id of a stored sequence, or its id, label, subject and covariates."""

Recording = Source | Info | Sequence[Any]
"""Source of a track: a file by its path or as its bytes, images that were sent before, or a cloud
(n, 3) for each frame."""

# Options that say which signature is meant; all others belong to what is made of it.
_OF_SIGNATURE: Final = frozenset(("amplitudes", *(one.name for one in fields(SignatureParameters))))
# Signatures a request, until the service states its limit.
_AT_ONCE: Final = 1000


class Unchanged(Enum):
    """Leaves a name as it is."""

    UNCHANGED = "unchanged"


UNCHANGED: Final = Unchanged.UNCHANGED


class Client:
    """A service: use it in a `with` block, or close it.

    Threads may share one. Options of a call are those of the service, by its names; a call
    waits for its result, whether the service gives it at once or leaves it to a job. `progress` is
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
        self._connection = Connection(
            base_url, key, timeout, schedule, transport, sleep, most_bytes
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._connection.close()

    # The service itself.

    def is_ready(self) -> bool:
        """Tell whether the service answers and can keep results."""
        try:
            self._get("/health/ready")
        except (RemoteError, UnreachableError):
            return False
        return True

    def limits(self) -> dict[str, float]:
        """Return the limits of the service, by the names that its errors use."""
        return dict(info_of(self._get("/v1/limits")))

    def jobs(self, *, state: str | None = None, page: int = 100) -> Iterator[JobStatus]:
        """List jobs from the newest to the oldest, fetched a page at a time."""
        return map(JobStatus.of, self._pages("/v1/jobs", "jobs", state=state, limit=page))

    def job(self, job_id: str, accept: str = "*/*") -> Job[Answer]:
        """Return a job by its id; its result is the unparsed answer to its link."""
        status = JobStatus.of(self._get(f"/v1/jobs/{segment(job_id)}").json)
        return Job(self._connection, status, lambda answer: answer, accept)

    def audit(self, *, owner: str | None = None, page: int = 100) -> Iterator[dict[str, Any]]:
        """List who did what, of all owners, from the newest to the oldest; needs `admin`."""
        return self._pages("/v1/audit", "entries", owner=owner, limit=page)

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
        return self._file("/v1/sequences", source, info_of, progress, options, is_keyed=True)

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

    def start_upload(
        self, source: Source, *, progress: Progress | None = None, **options: Option
    ) -> Job[Info]:
        """Send a sequence, and let a job of the service read it."""
        call = Call("POST", "/v1/sequences", options, body=body_of(source), is_keyed=True)
        return self._started(call, info_of, progress)

    def sequences(
        self,
        *,
        subject: str | None = None,
        label: str | None = None,
        tracked: bool = False,
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
        chosen = {"subject": subject, "label": label, "tracked": tracked or None, "limit": page}
        return map(Info, self._pages("/v1/sequences", "sequences", **chosen))

    def sequence(self, sequence_id: str) -> Info:
        """Describe a sequence.

        Raises
        ------
        NotFoundError
            If no sequence has that id.
        """
        return info_of(self._get(_sequence(sequence_id)))

    def update(
        self,
        sequence_id: str,
        *,
        subject: str | Unchanged | None = UNCHANGED,
        label: str | Unchanged | None = UNCHANGED,
        facts: Facts | Mapping[str, Any] | Unchanged | None = UNCHANGED,
    ) -> Info:
        """Change the subject, the label or facts; None removes one.

        Parameters
        ----------
        sequence_id : str
        subject, label : str or None, optional
        facts : Facts, mapping or None, optional
            Stated facts replace stored ones. In a mapping None makes a fact unknown, and
            removes one covariate: ``{"period": None, "covariates": {"age": None}}``.
        """
        if isinstance(facts, Facts):
            facts = plain({"facts": facts})
        names = {"subject": subject, "label": label, "facts": facts}
        changes = {name: value for name, value in names.items() if value is not UNCHANGED}
        call = Call("PATCH", _sequence(sequence_id), body=json_body(changes))
        return info_of(self._connection.send(call))

    def delete(self, sequence_id: str) -> None:
        """Delete a sequence with everything derived from it, its track too."""
        self._connection.send(Call("DELETE", _sequence(sequence_id)))

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
            return self._awaited(_made(sequence_id, options, HDF5), _own, progress)
        return _own(self._get(f"{_sequence(sequence_id)}/signature", accept=HDF5))

    def start_signature(self, sequence_id: str, **options: Option) -> Job[ModalSignature]:
        """Fit and store a signature in a job of the service."""
        return self._started(_made(sequence_id, options, HDF5), _own)

    def stored_signatures(self, sequence_id: str, *, page: int = 100) -> Iterator[Info]:
        """List the stored signatures of a sequence: their keys, parameters and errors."""
        path = f"{_sequence(sequence_id)}/signatures"
        return map(Info, self._pages(path, "signatures", limit=page))

    def delete_signature(self, key: str) -> None:
        """Delete a stored signature."""
        self._connection.send(Call("DELETE", f"/v1/signatures/{segment(key)}"))

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
        return self._file("/v1/signature", source, _own, progress, options, HDF5)

    def signatures_of(
        self,
        sources: Mapping[str, Source] | Iterable[Source],
        *,
        manifest: str | None = None,
        progress: Progress | None = None,
        **options: Option,
    ) -> list[SentResult[ModalSignature]]:
        """Return the modal signatures of many sequences sent along; nothing is stored.

        A file that cannot be read or fitted costs no other: it has its own error.

        Parameters
        ----------
        sources : iterable of (path, bytes or MeshSequence), or mapping of str to these
            Any number: they are sent in as few requests as the service allows.
        manifest : str, optional
            CSV with the columns path (the names of the files), subject, label and facts; for
            files that fit into one request.
        progress : callable, optional
            Called with the files that are done, and all.
        **options
            Of reading and of the signatures, as of `signature_of`; of all files.
        """
        return self._of_many(
            ("/v1/signature", ZIP), sources, manifest, signatures_in, progress, options
        )

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
            answers += self._awaited(_posted("/v1/signatures/query", request, NPZ), pack_of)
            if progress is not None:
                progress(len(answers) / len(ids))
        return answers

    def reconstruction(self, sequence_id: str, **options: Option) -> MeshSequence:
        """Return the surfaces that a signature describes.

        Parameters
        ----------
        sequence_id : str
        **options
            Of the signature; and times, in s, phases, shares of the cycle, or frames, so many in
            even steps: those of the recording by default.
        """
        return self._of_signature(sequence_id, "reconstruction", options, _sequence_of, NPZ)

    def distance(self, sequence_id: str, to: str, **options: Option) -> Comparison:
        """Return the distance of a sequence's signature from another's: 0 for the same motion."""
        own, rest = _parted(options)
        query = {**rest, "to": self._key(to, own)}
        found = self._of_signature(sequence_id, "distance", {**own, **query}, info_of)
        with understood("a distance"):
            by_errors = found["by_errors"]
            return Comparison(
                float(found["distance"]),
                bool(found["uses_theta_zero"]),
                None if by_errors is None else float(by_errors),
            )

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
        return self._of_signature(sequence_id, "readouts", options, info_of)

    def tradeoff(self, sequence_id: str, **options: Option) -> Info:
        """Return the cost and the loss of each choice of modes.

        Parameters
        ----------
        sequence_id : str
        **options
            Of the marked signature; and front_modes, only (components).
        """
        path = f"{_sequence(sequence_id)}/tradeoff"
        return self._awaited(_posted(path, options), info_of)

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
        call = _posted(path, options)
        # A job's result is the list of all models' answers: of what is kept this one's is asked.
        while (answer := self._connection.send(call)).status == 202:
            awaited(self._connection, answer, _content, call.accept)
        return info_of(answer)

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
        return self._file("/v1/classify", source, info_of, progress, options)

    def classes_of(
        self,
        sources: Mapping[str, Source] | Iterable[Source],
        *,
        manifest: str | None = None,
        progress: Progress | None = None,
        **options: Option,
    ) -> list[SentResult[Info]]:
        """Ask a model for the classes of many sequences sent along, as `signatures_of` does."""

        def read(answer: Answer) -> list[SentResult[Info]]:
            return results_in(answer, "classification", Info)

        return self._of_many(("/v1/classify", JSON), sources, manifest, read, progress, options)

    def classifications(self, sequence_id: str, *, page: int = 100) -> Iterator[Info]:
        """List the models' answers for a sequence."""
        path = f"/v1/signatures/{segment(sequence_id)}/classifications"
        return map(Info, self._pages(path, "classifications", limit=page))

    def models(self, *, page: int = 100) -> Iterator[Info]:
        """List models by name, each in its newest version, fetched a page at a time."""
        return map(Info, self._pages("/v1/models", "models", limit=page))

    def model(self, name: str) -> Info:
        """Describe a model, name or name@version; `card` is its card."""
        return info_of(self._get(f"/v1/models/{segment(name)}"))

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
        return self._awaited(_training(name, cases, options), info_of, progress)

    def start_training(self, name: str, cases: Iterable[Case], **options: Option) -> Job[Info]:
        """Start a training as `train` does, and do not wait for it."""
        return self._started(_training(name, cases, options), info_of)

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
        path = f"/v1/models/{segment(name)}/evaluations"
        return self._awaited(_of_cases(path, cases, options), info_of, progress)

    def delete_model(self, name: str) -> None:
        """Delete a version of a model, as name@version; its number is never used again."""
        self._connection.send(Call("DELETE", f"/v1/models/{segment(name)}"))

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
        from modalmotion.classification import FeatureTable

        def read(answer: Answer) -> FeatureTable:
            with understood("a table of features"):
                return FeatureTable.from_json(answer.json)

        return self._awaited(_of_cases("/v1/features", cases, options), read, progress)

    # Norms.

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
        call = _of_cases("/v1/norms", controls, {"name": name, **options}, is_keyed=True)
        return self._awaited(call, info_of, progress)

    def norms(self, *, page: int = 100) -> list[str]:
        """List the names of all norms."""
        return [str(one["name"]) for one in self._pages("/v1/norms", "norms", limit=page)]

    def norm(self, name: str) -> Info:
        """Describe a norm."""
        return info_of(self._get(f"/v1/norms/{segment(name)}"))

    def delete_norm(self, name: str) -> None:
        """Delete a norm; its name is free again."""
        self._connection.send(Call("DELETE", f"/v1/norms/{segment(name)}"))

    def deviations(self, sequences: Iterable[Case], norm: str, *, level: float = 0.05) -> Info:
        """Tell how far stored sequences lie from the controls of a norm, from five on together too.

        Parameters
        ----------
        sequences : iterable of str or mapping
            As for `train`.
        norm : str
        level : float
            Share of recordings like the controls that may be called a deviation.

        Returns
        -------
        Info
            The members of `modalmotion.norm.CohortDeviation`; `deviations` has those of each.

        Raises
        ------
        RemoteError
            If there are too few controls for the level, or one does not compare.
        """
        path = f"/v1/norms/{segment(norm)}/deviations"
        return self._awaited(_of_cases(path, sequences, {"level": level}), info_of)

    # Streams and templates.

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
        return self._file("/v1/encode", source, compressed_of, progress, options, STREAM)

    def encoded(self, sequence_id: str, **options: Option) -> CompressedSequence:
        """Return a stored sequence as a compressed stream: rms, max_error or bytes; effort."""
        return compressed_of(self._get(f"{_sequence(sequence_id)}/encoded", options, STREAM))

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
        return self._file("/v1/decode", source, _sequence_of, progress, ends, NPZ)

    def make_template(
        self, source: Source, *, progress: Progress | None = None, **options: Option
    ) -> Info:
        """Make the template of a sequence's reference frame, and store it.

        Parameters
        ----------
        source : path, bytes or MeshSequence
        progress : callable, optional
        **options
            How to read the file; topology, reference, weights, landmarks, merge_vertices, ...
        """
        return self._file("/v1/templates", source, info_of, progress, options)

    def templates(self, *, page: int = 100) -> list[str]:
        """List the ids of all templates."""
        return [str(one) for one in self._pages("/v1/templates", "templates", limit=page)]

    def template(self, template_id: str) -> Info:
        """Describe a template."""
        return info_of(self._get(f"/v1/templates/{segment(template_id)}"))

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
        path = f"/v1/templates/{segment(template_id)}/modes"
        return template_modes_of(self._get(path, {"modes": modes, **options}, NPZ))

    def delete_template(self, template_id: str) -> None:
        """Delete a template; signatures that were fitted on it stay."""
        self._connection.send(Call("DELETE", f"/v1/templates/{segment(template_id)}"))

    # Images and tracks.

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
        return self._file("/v1/images", source, info_of, progress, {}, is_keyed=True)

    def all_images(self, *, page: int = 100) -> Iterator[Info]:
        """List images from the newest to the oldest, fetched a page at a time."""
        return map(Info, self._pages("/v1/images", "images", limit=page))

    def images(self, images_id: str) -> Info:
        """Describe images.

        Raises
        ------
        NotFoundError
            If there are none of that id: they are deleted after tracking, where nobody keeps them.
        """
        return info_of(self._get(f"/v1/images/{segment(images_id)}"))

    def delete_images(self, images_id: str) -> None:
        """Delete images; tracks that were made of them stay."""
        self._connection.send(Call("DELETE", f"/v1/images/{segment(images_id)}"))

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

    def track(self, track_id: str) -> Track:
        """Return a stored track: the library's own, bit for bit.

        Raises
        ------
        NotFoundError
            If no track has that id, which is that of its sequence.
        """
        from modalmotion.tracking.hdf5 import track_from_hdf5

        answer = self._get(f"/v1/tracks/{segment(track_id)}", accept=HDF5)
        return track_from_hdf5(answer.content)

    # Files.

    def save(self, what: str, path: str | Path, name: Any = None, **options: Option) -> None:
        """Write an answer to a file, whose suffix says in which form.

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
        saved, media_type = form_of(what, target)
        place = saved.path
        if place.startswith("/v1/signatures/"):
            own, options = _parted(options)
            name = self._key(str(name), own)
        if "{}" in place:
            place = place.format(segment(str(name)))
        if saved.has_body:
            call = _posted(place, options, media_type)
        else:
            call = Call("GET", place, options, media_type)
        write(self._awaited(call, _content), target)

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
        own, rest = _parted(options)
        place = f"/v1/signatures/{self._key(sequence_id, own)}/dicom"
        write(self._file(place, study, _content, None, rest, ZIP), target)

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
        call = replace(track_call(source, {**options, "report": True}), accept=ZIP)
        write(self._awaited(call, _content, progress), target)

    # What all calls have in common.

    def _get(
        self, path: str, query: Mapping[str, Option] | None = None, accept: str = JSON
    ) -> Answer:
        return self._awaited(Call("GET", path, query, accept), lambda answer: answer)

    def _awaited(self, call: Call, read: Callable[[Answer], T], progress: Share | None = None) -> T:
        return awaited(self._connection, self._connection.send(call), read, call.accept, progress)

    def _file(
        self,
        path: str,
        source: Source,
        read: Callable[[Answer], T],
        progress: Progress | None,
        options: Mapping[str, Option],
        accept: str = JSON,
        *,
        is_keyed: bool = False,
    ) -> T:
        """Send a file along, and wait for what is made of it."""
        call = Call(
            *("POST", path, options, accept, body_of(source)),
            is_repeatable=not is_keyed,
            is_keyed=is_keyed,
        )
        return awaited(self._connection, self._connection.send(call, progress), read, accept)

    def _started(
        self, call: Call, read: Callable[[Answer], T], progress: Progress | None = None
    ) -> Job[T]:
        answer = self._connection.send(call.with_headers(Prefer="respond-async"), progress)
        if answer.status != 202:
            raise BrokenAnswerError(
                f"The service answered {answer.status} and started no job.",
                remedy="Make the call that waits for its result.",
            )
        return Job(self._connection, JobStatus.of(answer.json), read, call.accept)

    def _key(self, sequence_id: str, own: Mapping[str, Option]) -> str:
        """Key of a signature, made where options say which; a sequence stands for its usual one."""
        if not own:
            return segment(sequence_id)
        answer = self._awaited(_made(sequence_id, own, JSON), info_of)
        with understood("a signature"):
            return segment(str(answer["key"]))

    def _of_signature(
        self,
        sequence_id: str,
        what: str,
        options: Mapping[str, Option],
        read: Callable[[Answer], T],
        accept: str = JSON,
    ) -> T:
        own, query = _parted(options)
        path = f"/v1/signatures/{self._key(sequence_id, own)}/{what}"
        return self._awaited(Call("GET", path, query, accept), read)

    def _of_many(
        self,
        asked: tuple[str, str],
        sources: Mapping[str, Source] | Iterable[Source],
        manifest: str | None,
        read: Callable[[Answer], list[SentResult[T]]],
        progress: Progress | None,
        options: Mapping[str, Option],
    ) -> list[SentResult[T]]:
        """Send many files to a path for an answer of a type, in as few requests as are allowed."""
        files = named_bodies(sources)
        with understood("a list of limits"):
            limits = self.limits()
            most = int(limits["batch_files"]), int(limits["body_bytes"])
        requests = list(in_requests(files, *most))
        if manifest is not None and len(requests) > 1:
            raise ParameterError(
                f"{len(files)} files with a manifest do not fit into one request.",
                remedy="Send them in parts, each with a manifest of its own files.",
            )
        path, accept = asked
        results: list[SentResult[T]] = []
        for part in requests:
            body = form_body(part, manifest)
            call = Call("POST", path, options, accept, body, is_repeatable=True)
            answers = self._awaited(call, read)
            with understood("as many results as files"):
                # By the names that they have here: a form's may be written otherwise.
                results += [
                    replace(one, name=name) for (name, _), one in zip(part, answers, strict=True)
                ]
            if progress is not None:
                progress(len(results), len(files))
        return results

    def _pages(self, path: str, member: str, **query: Option) -> Iterator[Any]:
        """Yield the members of a list, page by page."""
        cursor: str | None = None
        while True:
            page = self._get(path, {**query, "cursor": cursor}).json
            with understood(f"a page of {member}"):
                members, following = list(page[member]), page["cursor"]
            yield from members
            if following is None:
                return
            if following == cursor:
                raise BrokenAnswerError(
                    f"The service gives the same page of {member} again and again.",
                    remedy="Check the version of the service.",
                )
            cursor = following

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


def _sequence(sequence_id: str) -> str:
    return f"/v1/sequences/{segment(sequence_id)}"


def _posted(path: str, options: Mapping[str, Option], accept: str = JSON) -> Call:
    return Call("POST", path, None, accept, json_body(plain(options)), is_repeatable=True)


def _made(sequence_id: str, options: Mapping[str, Option], accept: str) -> Call:
    return _posted(f"{_sequence(sequence_id)}/signatures", options, accept)


def _of_cases(
    path: str, cases: Iterable[Case], options: Mapping[str, Option], *, is_keyed: bool = False
) -> Call:
    listed = [case if isinstance(case, str) else dict(case) for case in cases]
    call = _posted(path, {"sequences": listed, **options})
    return replace(call, is_repeatable=not is_keyed, is_keyed=is_keyed)


def _training(name: str, cases: Iterable[Case], options: Mapping[str, Option]) -> Call:
    stated = {"name": name, "options": plain(options)}
    return _of_cases("/v1/models", cases, stated, is_keyed=True)


def _parted(options: Mapping[str, Option]) -> tuple[dict[str, Option], dict[str, Option]]:
    """Part options of a signature from those of what is made of it."""
    own = {name: value for name, value in options.items() if name in _OF_SIGNATURE}
    return own, {name: value for name, value in options.items() if name not in own}


def _content(answer: Answer) -> bytes:
    return answer.content


def _own(answer: Answer) -> ModalSignature:
    from modalmotion.store import signature_from_hdf5

    return signature_from_hdf5(answer.content)


def _sequence_of(answer: Answer) -> MeshSequence:
    return read_npz(answer.content).sequence
