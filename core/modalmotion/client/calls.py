"""Calls, each an endpoint and a method whose signature defines it, and jobs they wait for."""

import functools
import inspect
import re
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Final, Generic, TypeVar, cast

from modalmotion import store
from modalmotion.client import errors
from modalmotion.client.connection import (
    JSON,
    Answer,
    Call,
    Connection,
    Option,
    body_of,
    json_body,
    plain,
    retry_after,
    segment,
)
from modalmotion.client.values import NPZ, STREAM, Info, arrays_of, compressed_of, info_of
from modalmotion.formats.npz import read_npz
from modalmotion.progress import Progress, Reporter, silent
from modalmotion.signature.making import ModalSignature, SignatureParameters

F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T")

# Between two polls of a job, s: short at first, for most jobs are short.
_FIRST_PAUSE: Final = 0.05
_LONGEST_PAUSE: Final = 2.0


_ENDED: Final = ("succeeded", "failed", "cancelled")


def status_of(answer: Any) -> Info:
    """Read a description of a job: id, kind, state, progress from 0 to 1, result and error."""
    status = Info(answer)
    with errors.understood("a job"):
        segment(status["id"])
        is_text = isinstance(status["kind"], str) and isinstance(status["state"], str)
        is_link = status["result"] is None or isinstance(status["result"], str)
        is_problem = status["error"] is None or isinstance(status["error"], dict)
        if not (is_text and is_link and is_problem):
            raise TypeError
        float(status["progress"])
    return status


@dataclass(eq=False, repr=False)
class Job(Generic[T]):
    """A job, with the reader of its result.

    Parameters
    ----------
    service : Connection
    status : Info
        At the last poll: id, kind, state (queued, running, succeeded, failed or cancelled),
        progress (0 to 1), result (a link) and error (the problem it failed with).
    read : function
        Reads the result from the answer to its link.
    accept : str
        Media type to request the result in.
    """

    _service: "Caller"
    status: Info
    _read: Callable[[Answer], T]
    _accept: str

    def __repr__(self) -> str:
        return f"Job({self.id}, {self.status.kind}, {self.status.state})"

    @property
    def id(self) -> str:
        """Id of the job at the service."""
        return str(self.status["id"])

    def refresh(self) -> Info:
        """Fetch the current status."""
        self._poll()
        return self.status

    def cancel(self) -> None:
        """Cancel the job.

        Raises
        ------
        RemoteError
            With the code `conflict` if it has finished.
        """
        self.status = status_of(self._service._send(Call("DELETE", self._path)).json)

    def wait(self, *, timeout: float | None = None, progress: Reporter | None = None) -> T:
        """Wait for the result.

        Parameters
        ----------
        timeout : float, s, optional
            For ever by default; the job itself goes on afterwards.
        progress : callable, optional
            Called with the share that is done at each poll.

        Raises
        ------
        RemoteError
            The problem that the job failed with.
        JobCancelledError
            If it was cancelled.
        JobUnfinishedError
            If the time has passed.
        """
        end = None if timeout is None else time.monotonic() + timeout
        pause, report = _FIRST_PAUSE, progress or silent
        while True:
            requested = None if self._is_finished else self._poll()
            report(Progress(self.status.progress))
            if self._is_finished:
                return self._result()
            pause = min(
                2 * pause,
                _LONGEST_PAUSE if requested is None else max(requested, _FIRST_PAUSE),
            )
            if end is not None and time.monotonic() + pause > end:
                raise errors.JobUnfinishedError(
                    f"The job {self.id} is {self.status.state} after {timeout:g} s, "
                    f"{100 * self.status.progress:.0f} % done.",
                    remedy="Wait longer, now or later: it goes on by itself.",
                    details={"job": self.id},
                )
            self._service._sleep(pause)

    @property
    def _is_finished(self) -> bool:
        return self.status["state"] in _ENDED

    @property
    def _path(self) -> str:
        return f"/v1/jobs/{self.id}"

    def _poll(self) -> float | None:
        answer = self._service._send(Call("GET", self._path))
        self.status = status_of(answer.json)
        return retry_after(answer.headers.get("retry-after"))

    def _result(self) -> T:
        if self.status.state == "cancelled":
            raise errors.JobCancelledError(
                f"The job {self.id} was cancelled before it had a result.",
                remedy="Start it again.",
                details={"job": self.id},
            )
        if self.status["error"] is not None:
            problem = dict(self.status["error"])
            status = problem.get("status")
            error = errors.remote_error(problem, status if isinstance(status, int) else 500)
            error.details["job"] = self.id
            raise error
        link = self.status["result"]
        if link is None or not link.startswith("/"):
            raise errors.BrokenAnswerError(
                f"The job {self.id} has succeeded but names no result.",
                remedy="Check the version of the service.",
            )
        return self._service._awaited(Call("GET", link, accept=self._accept), self._read)


# Options that select the signature; all others belong to what is computed from it.
_OF_SIGNATURE: Final = frozenset(("amplitudes", *(one.name for one in fields(SignatureParameters))))
# Parameters that are lists of stored sequences: ids, or mappings with id, label and more.
_CASES: Final = ("cases", "controls", "sequences")
# Member of a page whose name is not the end of its path.
_MEMBERS: Final = {"audit": "entries"}


def call(
    endpoint: str, accept: str = JSON, *, is_keyed: bool = False, nests: bool = False
) -> Callable[[F], F]:
    """Make a method, of which only signature and docstring are written, send a request.

    Parameters named in the path go there, `{signature}` standing for the key of the signature that
    the sequence and the options name. `source` is the body, `progress` is called, and all others
    are options: members of a POST's JSON body, and else the query. The return annotation
    defines how the answer is read: a value, an `Iterator` over the pages of a list, or a `Job`.

    Parameters
    ----------
    endpoint : str
        Such as "GET /v1/sequences/{sequence_id}".
    accept : str
        Media type of the answer.
    is_keyed : bool
        Whether it carries an idempotency key: a POST that stores something.
    nests : bool
        Whether the options are one member of the body, and not members each.
    """
    method, _, path = endpoint.partition(" ")

    def decorate(function: F) -> F:
        signature = inspect.signature(function)
        # As it is written, without the modules of its names.
        form = re.sub(r"\w+\.", "", str(signature.return_annotation))
        kind, _, inner = form.rstrip("]").rpartition("[")
        # Of an object, the media type says how it is written.
        read = _READERS[accept if inner == "Info" and accept in _READERS else inner]

        @functools.wraps(function)
        def made(self: Caller, *args: Any, **options: Any) -> Any:
            given = signature.bind(self, *args, **options)
            given.apply_defaults()
            values = {name: one for name, one in given.arguments.items() if name != "self"}
            stated = values.pop("options", {})
            values |= {"options": plain(stated)} if nests else stated
            progress, source = values.pop("progress", None), values.pop("source", None)
            if "{signature}" in path:
                own, values = parted(values)
                values["signature"] = self._key(values.pop("sequence_id"), own)
            place = re.sub(r"{(\w+)}", lambda name: segment(str(values.pop(name[1]))), path)
            if kind == "Iterator":
                return map(read, self._pages(place, values))
            for name in _CASES:
                if name in values:
                    cases = values.pop(name)
                    values["sequences"] = [c if isinstance(c, str) else dict(c) for c in cases]
            query: Mapping[str, Option] | None = values
            body = None if source is None else body_of(source)
            if method == "POST" and source is None:
                query, body = None, json_body(plain(values))
            asked = Call(method, place, query, accept, body, None, not is_keyed, is_keyed)
            if kind == "Job":
                return self._started(asked, read, progress)
            return self._awaited(asked, read, progress, is_upload=source is not None)

        return cast(F, made)

    return decorate


class Caller(Connection):
    """What all calls to one service have in common.

    Parameters
    ----------
    connection : Connection
    """

    def _get(self, path: str, accept: str = JSON) -> Answer:
        return self._awaited(Call("GET", path, None, accept), lambda answer: answer)

    def _awaited(
        self,
        asked: Call,
        read: Callable[[Answer], T],
        progress: Any = None,
        *,
        is_upload: bool = False,
    ) -> T:
        """Send a request, and wait for its result; progress is of the upload, or of the job."""
        answer = self._send(asked, progress if is_upload else None)
        if answer.status != 202:
            return read(answer)
        job = Job(self, status_of(answer.json), read, asked.accept)
        return job.wait(progress=None if is_upload else progress)

    def _started(
        self, asked: Call, read: Callable[[Answer], T], progress: Reporter | None = None
    ) -> Job[T]:
        answer = self._send(replace(asked, headers={"Prefer": "respond-async"}), progress)
        if answer.status != 202:
            raise errors.BrokenAnswerError(
                f"The service answered {answer.status} and started no job.",
                remedy="Make the call that waits for its result.",
            )
        return Job(self, status_of(answer.json), read, asked.accept)

    def _key(self, sequence_id: str, own: Mapping[str, Option]) -> str:
        """Key of a signature, made where options say which; a sequence represents its usual one."""
        if not own:
            return segment(sequence_id)
        answer = self._awaited(signature_call(sequence_id, own, JSON), info_of)
        with errors.understood("a signature"):
            return segment(str(answer["key"]))

    def _pages(self, path: str, options: Mapping[str, Option]) -> Iterator[Any]:
        """Yield the members of a list, page by page; `page` is how many are fetched at once."""
        member = path.rpartition("/")[2]
        member = _MEMBERS.get(member, member)
        query = {"limit" if name == "page" else name: one for name, one in options.items()}
        cursor: str | None = None
        while True:
            asked = Call("GET", path, {**query, "cursor": cursor})
            page = self._awaited(asked, lambda answer: answer).json
            with errors.understood(f"a page of {member}"):
                members, following = list(page[member]), page["cursor"]
            yield from members
            if following is None:
                return
            if following == cursor:
                raise errors.BrokenAnswerError(
                    f"The service gives the same page of {member} again and again.",
                    remedy="Check the version of the service.",
                )
            cursor = following


def parted(options: Mapping[str, Option]) -> tuple[dict[str, Option], dict[str, Option]]:
    """Part options of a signature from those of what is made of it."""
    own = {name: one for name, one in options.items() if name in _OF_SIGNATURE and one is not None}
    return own, {name: one for name, one in options.items() if name not in _OF_SIGNATURE}


def posted(path: str, options: Mapping[str, Option], accept: str = JSON) -> Call:
    """Write a request that stores nothing, or one thing once, with its options as JSON."""
    return Call("POST", path, None, accept, json_body(plain(options)), is_repeatable=True)


def signature_call(sequence_id: str, options: Mapping[str, Option], accept: str) -> Call:
    """Write the request for a stored signature with these parameters."""
    return posted(f"/v1/sequences/{segment(sequence_id)}/signatures", options, accept)


def signature_of(answer: Answer) -> ModalSignature:
    """Read a signature: the library's own."""
    return store.signature_from_hdf5(answer.content)


def track_of(answer: Answer) -> Any:
    """Read a track: the library's own."""
    from modalmotion.tracking.hdf5 import track_from_hdf5

    return track_from_hdf5(answer.content)


def _features_of(answer: Answer) -> Any:
    from modalmotion.classification import FeatureTable

    with errors.understood("a table of features"):
        return FeatureTable.from_json(answer.json)


def _read(answer: Any) -> Any:
    """Read an object, or a member of a list."""
    return info_of(answer) if isinstance(answer, Answer) else Info(answer)


_READERS: Final[dict[str, Callable[[Any], Any]]] = {
    "FeatureTable": _features_of,
    "Info": _read,
    "MeshSequence": lambda answer: read_npz(answer.content).sequence,
    "ModalSignature": signature_of,
    "None": lambda _: None,
    "Track": track_of,
    "str": str,
    NPZ: arrays_of,
    STREAM: compressed_of,
}
"""How an answer, or a member of a list, is read, by the annotation of what comes back."""
