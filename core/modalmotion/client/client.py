"""A client of the modalmotion service: the table of its calls, each a method (see `call`)."""

# Methods without a body are filled in by `call`.
# mypy: disable-error-code="empty-body"

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from modalmotion import store
from modalmotion.client.calls import Job, call, parted, posted, status_of
from modalmotion.client.connection import (
    JSON,
    Answer,
    Call,
    Option,
    Source,
    body_of,
    json_body,
    segment,
)
from modalmotion.client.errors import RemoteError, UnreachableError
from modalmotion.client.recordings import Recording, Recordings, track_call
from modalmotion.client.values import (
    POSTED,
    ZIP,
    Info,
    form_of,
)
from modalmotion.errors import StoreError
from modalmotion.progress import Reporter

if TYPE_CHECKING:
    from modalmotion.classification import FeatureTable

Case = str | Mapping[str, Any]
"""The id of a stored sequence, or its id, label, subject and covariates."""


class Client(Recordings):
    """A service: use it in a `with` block, or close it.

    Threads may share one. Options of a call are those of the service, by its names; a call
    waits for its result, whether the service computes it at once or in a job. `progress` is
    called with the bytes of an upload sent so far and in all, or with the percentage of a job that
    is done, and 100.

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

    # The service itself.

    def is_ready(self) -> bool:
        """Whether the service answers and can store results."""
        try:
            self._get("/health/ready")
        except (RemoteError, UnreachableError):
            return False
        return True

    @call("GET /v1/jobs")
    def jobs(self, *, state: str | None = None, page: int = 100) -> Iterator[Info]:
        """List jobs from the newest to the oldest, fetched a page at a time."""

    def job(self, job_id: str, accept: str = "*/*") -> Job[Answer]:
        """Return a job by its id; its result is the unparsed answer to its link."""
        status = status_of(self._get(f"/v1/jobs/{segment(job_id)}").json)
        return Job(self, status, lambda answer: answer, accept)

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

    # Classes and models.

    @call("POST /v1/signatures/{sequence_id}/classifications")
    def classify(self, sequence_id: str, **options: Option) -> Info:
        """Ask a model for the class of a stored sequence's motion.

        Parameters
        ----------
        sequence_id : str
        **options
            model, the shipped one by default; coverage.
        """

    @call("POST /v1/classify")
    def classify_of(
        self, source: Source, *, progress: Reporter | None = None, **options: Option
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
        self,
        name: str,
        cases: Iterable[Case],
        *,
        progress: Reporter | None = None,
        **options: Option,
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
        self,
        name: str,
        cases: Iterable[Case],
        *,
        progress: Reporter | None = None,
        **options: Option,
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
        self, cases: Iterable[Case], *, progress: Reporter | None = None, **options: Option
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
        progress: Reporter | None = None,
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
            Level: share of recordings like the controls that are reported as deviating.

        Returns
        -------
        Info
            The members of `modalmotion.norm.CohortDeviation`; `deviations` has those of each.

        Raises
        ------
        RemoteError
            If there are too few controls for the level, or one does not compare.
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
        place, media_type = form_of(what, Path(path))
        if place.startswith("/v1/signatures/"):
            own, options = parted(options)
            name = self._key(str(name), own)
        if "{}" in place:
            place = place.format(segment(str(name)))
        if what in POSTED:
            asked = posted(place, options, media_type)
        else:
            asked = Call("GET", place, options, media_type)
        self._save(path, asked)

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
        own, rest = parted(options)
        place = f"/v1/signatures/{self._key(sequence_id, own)}/dicom"
        self._save(path, Call("POST", place, rest, ZIP, body_of(study), is_repeatable=True))

    def save_tracked_report(
        self,
        source: Recording,
        path: str | Path,
        *,
        progress: Reporter | None = None,
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
        asked = replace(track_call(source, {**options, "report": True}), accept=ZIP)
        self._save(path, asked, progress)

    def _save(self, path: str | Path, asked: Call, progress: Reporter | None = None) -> None:
        place = Path(path)
        if not place.parent.is_dir():  # before minutes of work are asked for
            raise StoreError(
                f"'{place.name}' cannot be written: there is no folder '{place.parent}'.",
                remedy="Make the folder, or name a file in another one.",
            )
        store.write_atomic(place, self._awaited(asked, lambda answer: answer.content, progress))
