"""Errors as application/problem+json (RFC 9457), every one of them."""

import json
import logging
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final, cast

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import Response

from modalmotion import errors as kinds
from modalmotion.store.disk import cannot_write, is_of_the_machine
from modalmotion_service.access.scopes import calls_like, methods_of
from modalmotion_service.errors import ServiceError

logger = logging.getLogger(__name__)


# Of errors of the library, looked up along their ancestry: the nearest entry decides.
STATUS_OF: Final[dict[type[kinds.ModalMotionError], int]] = {
    kinds.LimitError: 413,
    kinds.MalformedFileError: 400,
    kinds.InputError: 422,
    kinds.NotFoundError: 404,
    kinds.CorruptFileError: 500,
    kinds.LostFileError: 409,
    kinds.StoreError: 503,
    kinds.MissingExtraError: 501,
    kinds.ModalMotionError: 500,
}

# Faults of a request that its problem names, and characters of each text in it.
_NAMED: Final = 50
_NAMED_IN_REMEDY: Final = 3
_LONGEST_TEXT: Final = 2000

_HEADERS_OF: Final[dict[int, dict[str, str]]] = {
    401: {"WWW-Authenticate": 'Bearer realm="modalmotion"'},
    # Nothing more is read from a slow client, so its connection is of no use.
    408: {"Connection": "close"},
    413: {"Connection": "close"},
    429: {"Retry-After": "1"},
    503: {"Retry-After": "5"},
}


def problem_body(error: kinds.ModalMotionError) -> dict[str, object]:
    """Make the body of the problem that one of our own errors is."""
    if isinstance(error, ServiceError):
        status = error.status
    else:
        status = next(STATUS_OF[kind] for kind in type(error).__mro__ if kind in STATUS_OF)
    if error.details.get("errno") in ("ENOSPC", "EDQUOT"):
        status = 507
    named = {name: getattr(error, name) for name in ("frame", "vertex", "limit")}
    named = {name: value for name, value in named.items() if value is not None}
    remedy = {"remedy": error.remedy} if error.remedy else {}
    return _body(status, error.code, error.message, {**error.details, **named, **remedy})


def problem_of(error: kinds.ModalMotionError) -> Response:
    """Make the problem answer of one of our own errors."""
    wait = error.details.get("retry_after_seconds")
    return _answer(problem_body(error), {"Retry-After": str(wait)} if wait else None)


def internal_answer() -> Response:
    """Make the answer to a request that failed by a fault of ours."""
    return _answer(internal_problem())


def internal_problem() -> dict[str, object]:
    """Make the body of the problem that a fault of ours is; it tells nothing of the inside."""
    return _body(
        500,
        "internal_error",
        "The server failed on this request; the fault is ours.",
        {"remedy": "Try again, and report it with the time if it comes back."},
    )


def _body(status: int, code: str, detail: str, members: Mapping[str, object]) -> dict[str, object]:
    return {
        "type": f"urn:modalmotion:problem:{code}",
        "title": HTTPStatus(status).phrase,
        "status": status,
        "code": code,
        "detail": _short(detail),
        **{name: _short(value) for name, value in members.items()},
    }


def _short(value: object) -> object:
    # Long input is repeated in part only: a small request must not get a large problem.
    if isinstance(value, str) and len(value) > _LONGEST_TEXT:
        return f"{value[:_LONGEST_TEXT]}..."
    return value


def _answer(body: dict[str, object], headers: Mapping[str, str] | None = None) -> Response:
    status = cast("int", body["status"])
    return Response(
        # Text that a client sent may contain lone surrogates: escaped, they are plain ASCII.
        json.dumps(body, ensure_ascii=True),
        status_code=status,
        media_type="application/problem+json",
        headers={**_HEADERS_OF.get(status, {}), **(headers or {})},
    )


def install(app: FastAPI) -> None:
    """Have the app answer every error as a problem."""
    app.add_exception_handler(kinds.ModalMotionError, _on_own_error)
    app.add_exception_handler(OSError, _on_fault_of_the_machine)
    app.add_exception_handler(RequestValidationError, _on_invalid_request)
    app.add_exception_handler(HTTPException, _on_http_exception)


async def _on_own_error(request: Request, error: Any) -> Response:
    answer = problem_of(error)
    if answer.status_code >= 500:
        logger.error(
            "request failed",
            extra={
                "request_id": request.scope.get("modalmotion.request_id"),
                "method": request.method,
                "code": error.code,
                # Such as ENOSPC; never the text, which may contain what a client sent.
                "errno": error.details.get("errno"),
            },
        )
    return answer


async def _on_fault_of_the_machine(request: Request, error: Any) -> Response:
    if not is_of_the_machine(error):
        raise error
    return await _on_own_error(request, cannot_write(Path(error.filename or "a file"), error))


async def _on_invalid_request(request: Request, error: Any) -> Response:
    if hasattr(request.state, "remove_upload"):
        request.state.remove_upload()
    found = error.errors()
    errors: list[dict[str, Any]] = [
        {"where": ".".join(map(str, item["loc"])), "message": item["msg"]}
        for item in found[:_NAMED]
    ]
    first = errors[0] if errors else {"where": "request", "message": "not valid"}
    members = {"errors": errors, "remedy": remedy_of(found)}
    return _answer(_body(422, "invalid_request", f"{first['where']}: {first['message']}.", members))


async def _on_http_exception(request: Request, error: Any) -> Response:
    if isinstance(error.__cause__, kinds.ModalMotionError):
        # FastAPI hides what fails while it reads a JSON body behind a 400 of its own.
        return problem_of(error.__cause__)
    phrase = HTTPStatus(error.status_code).phrase
    detail = error.detail
    if detail == phrase:
        detail = f"{detail}: {request.method} {request.url.path}"
    code = phrase.lower().replace(" ", "_").replace("-", "_")
    headers, members = dict(error.headers or {}), {}
    if error.status_code == 404 and error.detail == phrase:
        near = " or ".join(calls_like(request.url.path))
        members["remedy"] = f"/docs lists all calls{near and f'; perhaps {near} is meant'}."
    if error.status_code == 405:
        # The router names the methods of one of a path's routes; RFC 9110 requires all.
        headers["Allow"] = ", ".join(methods_of(request.url.path))
    return _answer(_body(error.status_code, code, detail, members), headers)


def remedy_of(errors: Sequence[Mapping[str, Any]]) -> str:
    """Name the parameters of a request that are to be corrected.

    Parameters
    ----------
    errors : sequence of mapping
        As pydantic gives them, with `loc`: "query" or "body", the parameter, and a place in it.
    """
    if errors and (elsewhere := errors[0].get("ctx", {}).get("remedy")):
        return str(elsewhere)
    places = [error.get("loc", ())[1:2] for error in errors]
    names = dict.fromkeys(one[0] for one in places if one and isinstance(one[0], str))
    what = ", ".join(list(names)[:_NAMED_IN_REMEDY]) or "the request"
    return f"Correct {what}; /docs describes the parameters of this call."
