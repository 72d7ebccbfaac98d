"""One service over HTTP: what is sent, requests, retries, and errors in the library's own words."""

from __future__ import annotations

import io
import json
import math
import re
import secrets
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self
from urllib.parse import urlsplit

import numpy as np

from modalmotion import representation
from modalmotion.client.errors import (
    BrokenAnswerError,
    RemoteError,
    UnreachableError,
    error_of_answer,
    understood,
)
from modalmotion.errors import MalformedFileError, ParameterError, needs_extra
from modalmotion.formats.npz import write_npz
from modalmotion.mesh import Facts, facts_as_json, sequence
from modalmotion.progress import Progress, Reporter
from modalmotion.representation import shown

Source = str | Path | bytes | bytearray | memoryview | sequence.MeshSequence
"""Source of an upload: a file by its path, the bytes of a file, or a sequence."""

# Large enough that Python's overhead is small, small enough that copies do not matter.
_PIECE: Final = 1 << 18


@dataclass(frozen=True)
class Body:
    """The body of a request.

    Parameters
    ----------
    source : bytes or Path
        A file is read a piece at a time, from its beginning at each attempt.
    n_bytes : int
    media_type : str
    """

    source: bytes | Path
    n_bytes: int
    media_type: str = "application/octet-stream"

    def sent(self, progress: Reporter | None) -> Iterator[bytes]:
        """Yield the pieces, and report progress after each."""
        done, source = 0, self.source
        try:
            with io.BytesIO(source) if isinstance(source, bytes) else source.open("rb") as file:
                while piece := file.read(_PIECE):
                    yield piece
                    done += len(piece)
                    if progress is not None:
                        progress(Progress(min(done, self.n_bytes), self.n_bytes))
        except OSError as error:
            if not isinstance(source, Path):
                raise
            raise _unreadable(source, error) from error


def body_of(source: Source) -> Body:
    """Make the body of a source: a file is read as it is sent, a sequence written beforehand.

    Raises
    ------
    MalformedFileError
        If the file cannot be read.
    """
    if isinstance(source, sequence.MeshSequence):
        source = write_npz(source)
    if isinstance(source, bytes | bytearray | memoryview):
        return Body(data := bytes(source), len(data))
    path = Path(source)
    try:
        return Body(path, path.stat().st_size)
    except OSError as error:
        raise _unreadable(path, error) from error


def json_body(value: object) -> Body:
    """Make the body of a JSON value."""
    text = json.dumps(value).encode()
    return Body(text, len(text), "application/json")


def _unreadable(path: Path, error: OSError) -> MalformedFileError:
    return MalformedFileError(
        f"'{path.name}' cannot be read: {error.strerror}.", remedy="Name a file to send."
    )


Option = Any
"""Value of an option, as JSON, NumPy or an enumeration has it; None is the default of the
service. Facts are several options at once."""

# Neither a separator, nor the end of a path, nor a name such as "..".
_SEGMENT: Final = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._@-]{0,199}")


def segment(name: str) -> str:
    """Check an id that becomes part of a path: it names one thing, and leads nowhere else.

    Raises
    ------
    ParameterError
        If it is not a valid id.
    """
    if _SEGMENT.fullmatch(name) is None:
        raise ParameterError(
            f"{name[:80]!r} cannot be an id.", remedy="Use an id from the service."
        )
    return name


def plain(options: Mapping[str, Option]) -> dict[str, Any]:
    """Write options as the members of a JSON body: arrays as lists, NaN as null."""
    members: dict[str, Any] = {}
    for name, value in options.items():
        if isinstance(value, Facts):
            stated = facts_as_json(value)
            members |= {fact: stated[fact] for fact in value.stated}
        elif value is not None:
            members[name] = _known(representation.plain(value))
    return members


def query_of(options: Mapping[str, Option]) -> dict[str, str]:
    """Write options as a query: 32,64 for a grid, true, false, objects as JSON."""
    return {name: _text(value) for name, value in plain(options).items()}


def _known(value: Any) -> Any:
    """Give a value of JSON with null for each place in it that is not known."""
    if isinstance(value, dict):
        return {name: _known(one) for name, one in value.items()}
    if not isinstance(value, list):
        return value
    parts = [_known(one) for one in value]
    is_place = all(part is None or isinstance(part, int | float) for part in parts)
    return None if is_place and None in parts else parts


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list) and not any(isinstance(one, list | dict) for one in value):
        return ",".join(str(part) for part in value)
    return json.dumps(value) if isinstance(value, list | dict) else str(value)


if TYPE_CHECKING:
    import httpx2

# The service is busy or restarting, or a proxy lost it.
_PASSING: Final = frozenset({408, 425, 429, 502, 503, 504})


@shown("attempts", "first_wait", "longest_wait", "deadline")
@dataclass(frozen=True)
class Retries:
    """How often a request is sent again, and after how long.

    Only requests that may be repeated are: those that change nothing, that leave the same
    state however often they come, or that carry an idempotency key.

    Parameters
    ----------
    attempts : int
        How often a request is sent at most; 1 never sends one again.
    first_wait, longest_wait : float, s
        Before the second attempt, doubled before each further one up to the longest. The
        service may ask for more (Retry-After).
    deadline : float, s
        For a call with all its attempts; no wait extends beyond it.
    rng : numpy.random.Generator
        Spreads the waits, so that clients that failed together do not come back together.

    Notes
    -----
    Brooker, Exponential backoff and jitter, AWS Architecture Blog, 2015.
    """

    attempts: int = 5
    first_wait: float = 0.2
    longest_wait: float = 20.0
    deadline: float = 600.0
    rng: np.random.Generator = field(default_factory=np.random.default_rng, compare=False)

    def __post_init__(self) -> None:
        if self.attempts < 1 or not 0 <= self.first_wait <= self.longest_wait:
            raise ParameterError(
                f"{self.attempts} attempts with waits of {self.first_wait} to "
                f"{self.longest_wait} s do not make a schedule of retries.",
                remedy="Use at least one attempt, and a first wait not above the longest.",
            )

    def wait(self, attempt: int, requested: float | None = None) -> float:
        """Seconds to wait after an attempt has failed.

        Parameters
        ----------
        attempt : int
            Counted from 0.
        requested : float, s, optional
            Wait that the service requested.
        """
        longest = min(self.longest_wait, self.first_wait * 2.0**attempt)
        own = float(self.rng.uniform(0.5, 1.0)) * longest
        return own if requested is None else requested + 0.1 * own


def retry_after(header: str | None) -> float | None:
    """Read a Retry-After header in seconds, as the service sends it; None for anything else."""
    text = (header or "").strip()
    return float(text) if text.isascii() and text.isdigit() and len(text) < 10 else None


JSON: Final = "application/json"

# Answer to a keyed request whose first attempt is still at work.
_STILL_UNDER_WAY: Final = 409

MOST_BYTES: Final = 2_000_000_000
"""Default limit of an answer: twice that of an unpacked upload."""

_KEY: Final = re.compile(r"[\x21-\x7e]+")

_LOOPBACK: Final = r"localhost|127\.[0-9.]+|::1"

# Methods that may be sent twice for every path.
_SAFE: Final = frozenset({"GET", "HEAD", "PUT", "DELETE", "PATCH"})


@dataclass(frozen=True)
class Call:
    """A request that has not been sent.

    Parameters
    ----------
    method, path : str
        The path begins with a slash, and may contain a query.
    query : mapping
    accept : str
        Media type of the answer.
    body : Body, optional
    headers : mapping
    is_repeatable : bool
        Whether it may be sent twice though it is a POST: it stores nothing, or one thing once.
    is_keyed : bool
        Whether it carries an idempotency key, and may be sent twice for that reason.
    """

    method: str
    path: str
    query: Mapping[str, Option] | None = None
    accept: str = JSON
    body: Body | None = None
    headers: Mapping[str, str] | None = None
    is_repeatable: bool = False
    is_keyed: bool = False


@shown("status", "content")
@dataclass(frozen=True)
class Answer:
    """Answer of the service, read to its end.

    Parameters
    ----------
    status : int
        Below 400.
    headers : mapping
        Names in lower case.
    content : bytes
    """

    status: int
    headers: Mapping[str, str]
    content: bytes

    @property
    def json(self) -> Any:
        """The content as JSON.

        Raises
        ------
        BrokenAnswerError
            If it is not JSON.
        """
        with understood("JSON"):
            return json.loads(self.content)


class Connection:
    """Connections to one service, kept open between calls; see `Client` for the parameters.

    `key` is sent to this service alone, for redirections are not followed. A path in `base_url`
    goes before the service's own, and `sleep` (seconds) serves all who wait for this service.
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
        with needs_extra("client"):
            import httpx2

        parts = urlsplit(base_url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ParameterError(
                f"{base_url[:80]!r} is not the address of a service.",
                remedy="Give one such as http://127.0.0.1:8000.",
            )
        headers = {"User-Agent": f"modalmotion-client/{version('modalmotion')}"}
        if key is not None:
            headers["Authorization"] = f"Bearer {_plain_key(key)}"
        self._retries = retries or Retries()
        self._most_bytes = most_bytes
        self._sleep = sleep
        self._http = httpx2.Client(
            base_url=base_url,
            headers=headers,
            timeout=timeout,
            transport=transport,
            # Proxies that the environment names are for other hosts.
            trust_env=not re.fullmatch(_LOOPBACK, parts.hostname),
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def _send(self, call: Call, progress: Reporter | None = None) -> Answer:
        """Send a request, retry where that is safe and may help, and read its answer.

        Parameters
        ----------
        call : Call
        progress : callable, optional
            Called with the body's bytes; starts over at each attempt.

        Raises
        ------
        RemoteError
            If the service answers with a problem.
        UnreachableError
            If no answer comes.
        """
        if call.is_keyed:
            key = {"Idempotency-Key": secrets.token_hex(16)}
            call = replace(call, headers={**(call.headers or {}), **key})
        may_repeat = call.method in _SAFE or call.is_repeatable or call.is_keyed
        end = time.monotonic() + self._retries.deadline
        for attempt in range(self._retries.attempts):
            requested = None
            try:
                return self._attempt(call, progress, end)
            except RemoteError as error:
                if attempt and call.method == "DELETE" and error.status == 404:
                    # Deleted by an attempt whose answer was lost.
                    return Answer(204, {}, b"")
                requested = error.details.get("retry_after")
                waits = (error.status in _PASSING and may_repeat) or (
                    attempt > 0 and call.is_keyed and error.status == _STILL_UNDER_WAY
                )
                failure: RemoteError | UnreachableError = error
            except UnreachableError as error:
                # Where nothing was sent nothing can happen twice.
                waits = may_repeat or bool(error.details.get("nothing_sent"))
                failure = error
            wait = self._retries.wait(attempt, requested if isinstance(requested, float) else None)
            is_last = attempt + 1 == self._retries.attempts
            if not waits or is_last or time.monotonic() + wait > end:
                raise failure
            self._sleep(wait)
        raise AssertionError("at least one attempt is made")

    def _attempt(self, call: Call, progress: Reporter | None, end: float) -> Answer:
        if not call.path.startswith("/"):
            # Another host's address would be sent the key.
            raise ParameterError(
                f"{call.path[:80]!r} is not a path of the service.",
                remedy="Begin it with a slash, such as /v1/limits.",
            )
        headers = {"Accept": call.accept, **(call.headers or {})}
        content: Iterator[bytes] | None = None
        if call.body is not None:
            headers["Content-Type"] = call.body.media_type
            headers["Content-Length"] = str(call.body.n_bytes)
            content = _until(end, call.body.sent(progress))
        with _explained(call):
            request = self._http.build_request(
                call.method,
                # One slash alone: two begin the name of a host, none a scheme.
                f"/{call.path.lstrip('/')}",
                params=query_of(call.query) if call.query else None,
                headers=headers,
                content=content,
            )
            response = self._http.send(request, stream=True)
            try:
                pieces = _until(end, response.iter_bytes(), self._most_bytes)
                payload = b"".join(pieces)
            finally:
                response.close()
        answer_headers = {name.lower(): value for name, value in response.headers.items()}
        if response.status_code < 300:
            return Answer(response.status_code, answer_headers, payload)
        error = error_of_answer(
            response.status_code,
            payload,
            answer_headers.get("content-type", ""),
            answer_headers.get("x-request-id", ""),
        )
        wait = retry_after(answer_headers.get("retry-after"))
        # From the header alone: a member of the problem may be anything.
        error.details.pop("retry_after", None)
        if wait is not None:
            error.details["retry_after"] = wait
        raise error


def _plain_key(key: str) -> str:
    # A key read from a file may end with a line break. Other faults are reported here, for the
    # HTTP library's error would repeat the key.
    plain = key.strip()
    if _KEY.fullmatch(plain) is None:
        raise ParameterError(
            "The key is empty, or contains blanks or characters outside ASCII.",
            remedy="Give it as `modalmotion keys create` showed it.",
        )
    return plain


def _until(end: float, pieces: Iterator[bytes], most: float = math.inf) -> Iterator[bytes]:
    """Pass pieces on up to a moment of `time.monotonic`, and up to a number of bytes."""
    n_bytes = 0
    for piece in pieces:
        n_bytes += len(piece)
        if n_bytes > most:
            raise BrokenAnswerError(
                f"The answer is longer than {most} bytes.",
                remedy="Ask for less at once, or allow more as `most_bytes`.",
                limit="most_bytes",
                details={"most": most},
            )
        if time.monotonic() > end:
            raise UnreachableError(
                "The call did not finish before its deadline.",
                remedy="Allow a longer deadline, or send and ask for less.",
            )
        yield piece


@contextmanager
def _explained(call: Call) -> Iterator[None]:
    import httpx2

    what = f"{call.method} {call.path.partition('?')[0]}"
    nothing_sent = (httpx2.ConnectError, httpx2.ConnectTimeout, httpx2.PoolTimeout)
    try:
        yield
    except nothing_sent as error:
        raise UnreachableError(
            f"{what}: cannot connect to the service ({error}).",
            remedy="Check the address, and that the service runs.",
            details={"nothing_sent": True},
        ) from error
    except (httpx2.HTTPError, httpx2.StreamError, httpx2.InvalidURL) as error:
        raise UnreachableError(
            f"{what}: the connection broke, or met its timeout ({type(error).__name__}: {error}).",
            remedy="Send it again, with a longer timeout; or look at the service's log.",
        ) from error
