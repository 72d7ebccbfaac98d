"""Errors of calls: problems that the service reports, and failures on the way to it.

::

    ModalMotionError
    ├── RemoteError            the service answered with a problem; also of the class that the
    │                          library raises for the same thing (NotFoundError, LimitError, ...)
    ├── UnreachableError       no answer came, after all the retries that were safe
    ├── BrokenAnswerError      an answer came that is not what the service gives
    ├── JobCancelledError      the job was cancelled before it had a result
    └── JobUnfinishedError     the job is not finished after the given time
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any, Final

from modalmotion.errors import ModalMotionError

_MEMBERS: Final = (
    "type",
    "title",
    "status",
    "code",
    "detail",
    "remedy",
    "frame",
    "vertex",
    "limit",
)


class RemoteError(ModalMotionError):
    """The service answered with a problem.

    It is also of the class that the library itself raises for the same thing: code that catches
    `NotFoundError` or `LimitError` from a local call catches it from a remote one.

    Attributes
    ----------
    code : str
        Stable name of the kind of problem.
    status : int
        Of the answer.
    request_id : str
        Quote it in a report; the service's log contains it.
    frame, vertex : int or None
    limit : str or None
    remedy : str
    """

    code = "remote_error"
    status: int = 0
    request_id: str = ""

    def __reduce__(self) -> tuple[object, ...]:
        # The class is created from its code, again when unpickled.
        return _rebuild, (self.code, self.__dict__.copy())


class UnreachableError(ModalMotionError):
    """No answer came."""

    code = "unreachable"


class BrokenAnswerError(ModalMotionError):
    """An answer came that is not what the service gives."""

    code = "broken_answer"


class JobCancelledError(ModalMotionError):
    """The job was cancelled before it had a result."""

    code = "job_cancelled"


class JobUnfinishedError(ModalMotionError):
    """The job is not finished yet."""

    code = "job_unfinished"


def remote_error(problem: dict[str, Any], status: int, request_id: str = "") -> RemoteError:
    """Make the error for a problem (RFC 9457).

    Parameters
    ----------
    problem : dict
        Its members.
    status : int
        Of the answer.
    request_id : str
    """
    code, frame, vertex = (problem.get(name) for name in ("code", "frame", "vertex"))
    limit = problem.get("limit")
    error = _class_of(code if isinstance(code, str) else "remote_error")(
        str(problem.get("detail") or problem.get("title") or f"The service answered {status}."),
        remedy=str(problem.get("remedy", "")),
        frame=frame if isinstance(frame, int) else None,
        vertex=vertex if isinstance(vertex, int) else None,
        limit=limit if isinstance(limit, str) else None,
        details={name: value for name, value in problem.items() if name not in _MEMBERS},
    )
    error.status, error.request_id = status, request_id
    return error


def error_of_answer(status: int, body: bytes, media_type: str, request_id: str) -> RemoteError:
    """Make the error for an answer, a problem or not: proxies answer in their own words."""
    problem: Any = None
    if "json" in media_type:
        try:
            problem = json.loads(body)
        except (ValueError, RecursionError):
            problem = None
    if not isinstance(problem, dict):
        problem = {
            "detail": f"The service, or a proxy before it, answered {status}.",
            "remedy": "Check the address; a proxy may have a limit of its own.",
        }
    return remote_error(problem, status, request_id)


@lru_cache(maxsize=128)
def _class_of(code: str) -> type[RemoteError]:
    own = next((kind for kind in _kinds(ModalMotionError) if kind.code == code), None)
    bases = (RemoteError,) if own is None else (RemoteError, own)
    name = "RemoteError" if own is None else f"Remote{own.__name__}"
    return type(name, bases, {"code": code, "__doc__": RemoteError.__doc__})


@contextmanager
def understood(what: str) -> Iterator[None]:
    """Turn any error of reading an answer into a `BrokenAnswerError`.

    Parameters
    ----------
    what : str
        Noun for the expected answer, such as "a job".

    Raises
    ------
    BrokenAnswerError
    """
    try:
        yield
    except ModalMotionError:
        raise
    except Exception as error:  # whatever an answer of another form leads to
        raise BrokenAnswerError(
            f"The answer is not {what}.",
            remedy="Check the address, and the versions of service and client.",
        ) from error


def _kinds(kind: type[ModalMotionError]) -> Iterator[type[ModalMotionError]]:
    for below in kind.__subclasses__():
        # Of this library: a service in the same process has errors of its own.
        if below.__module__ == ModalMotionError.__module__:
            yield below
            yield from _kinds(below)


def _rebuild(code: str, state: dict[str, Any]) -> RemoteError:
    error = _class_of(code)(str(state["message"]))
    error.__dict__.update(state)
    return error
