"""A client of the modalmotion service."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Self

from modalmotion.client.bodies import json_body
from modalmotion.client.codec_calls import CodecCalls
from modalmotion.client.connection import MOST_BYTES, Answer, Call, Connection
from modalmotion.client.errors import RemoteError, UnreachableError
from modalmotion.client.feature_calls import FeatureCalls
from modalmotion.client.image_calls import ImageCalls
from modalmotion.client.jobs import Job, JobStatus
from modalmotion.client.model_calls import ModelCalls
from modalmotion.client.norm_calls import NormCalls
from modalmotion.client.query import Option, segment
from modalmotion.client.readout_calls import ReadoutCalls
from modalmotion.client.report_calls import ReportCalls
from modalmotion.client.retries import Retries
from modalmotion.client.sequence_calls import SequenceCalls
from modalmotion.client.signature_calls import SignatureCalls
from modalmotion.client.template_calls import TemplateCalls
from modalmotion.client.track_calls import TrackCalls

if TYPE_CHECKING:
    import httpx2


class Client(
    SequenceCalls,
    SignatureCalls,
    ReadoutCalls,
    ReportCalls,
    ModelCalls,
    NormCalls,
    FeatureCalls,
    CodecCalls,
    TemplateCalls,
    ImageCalls,
    TrackCalls,
):
    """A service: use it in a `with` block, or close it.

    Threads may share one. Options of a call are those of the service, by its names; a call
    waits for its result, whether the service gives it at once or leaves it to a job.

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

    def is_ready(self) -> bool:
        """Tell whether the service answers and can keep results."""
        try:
            self._get("/health/ready")
        except (RemoteError, UnreachableError):
            return False
        return True

    def limits(self) -> dict[str, float]:
        """Return the limits of the service, by the names that its errors use."""
        limits: dict[str, float] = self._get("/v1/limits").json
        return limits

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
        self,
        method: str,
        path: str,
        *,
        json: Any = None,
        accept: str = "application/json",
        **query: Option,
    ) -> Answer:
        """Send any request, such as one without a method here.

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
        return self._connection.send(Call(method, path, query, accept, body))
