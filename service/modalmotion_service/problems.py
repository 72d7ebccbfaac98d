"""Errors as application/problem+json (RFC 9457), every one of them."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any, Final

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import Response

from modalmotion.errors import (
    CorruptFileError,
    InputError,
    LimitError,
    MalformedFileError,
    ModalMotionError,
    NotFoundError,
    StoreError,
)

logger = logging.getLogger(__name__)

# Looked up along an error's ancestry: the nearest entry decides.
STATUS_OF: Final[dict[type[ModalMotionError], int]] = {
    LimitError: 413,
    MalformedFileError: 400,
    InputError: 422,
    NotFoundError: 404,
    CorruptFileError: 500,
    StoreError: 503,
    ModalMotionError: 500,
}


def problem(
    status: int,
    code: str,
    detail: str,
    *,
    members: Mapping[str, object] | None = None,
    headers: Mapping[str, str] | None = None,
) -> Response:
    """Make a problem answer.

    Parameters
    ----------
    status : int
    code : str
        Stable name of the kind of problem, for programs.
    detail : str
        What is wrong here, for people.
    members : dict, optional
        Further members: frame, vertex, limit, remedy, ...
    headers : dict, optional
    """
    body: dict[str, object] = {
        "type": f"urn:modalmotion:problem:{code}",
        "title": HTTPStatus(status).phrase,
        "status": status,
        "code": code,
        "detail": detail,
        **(members or {}),
    }
    return Response(
        # Text that a client sent may hold lone surrogates: escaped, they are plain ASCII.
        json.dumps(body, ensure_ascii=True),
        status_code=status,
        media_type="application/problem+json",
        headers=dict(headers or {}),
    )


def problem_of(error: ModalMotionError) -> Response:
    """Make the problem answer of one of our own errors."""
    status = next(STATUS_OF[kind] for kind in type(error).__mro__ if kind in STATUS_OF)
    members: dict[str, object] = dict(error.details)
    for name in ("frame", "vertex", "limit"):
        value = getattr(error, name)
        if value is not None:
            members[name] = value
    if error.remedy:
        members["remedy"] = error.remedy
    return problem(status, error.code, error.message, members=members)


def install(app: FastAPI) -> None:
    """Have the app answer every error as a problem."""
    app.add_exception_handler(ModalMotionError, _on_own_error)
    app.add_exception_handler(RequestValidationError, _on_invalid_request)
    app.add_exception_handler(HTTPException, _on_http_exception)
    app.add_exception_handler(Exception, _on_unexpected)


async def _on_own_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, ModalMotionError)  # noqa: S101 (registered for this type alone)
    answer = problem_of(error)
    if answer.status_code >= 500:
        logger.error("%s %s: %s", request.method, request.url.path, error.code)
    return answer


async def _on_invalid_request(_: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)  # noqa: S101 (registered for this type alone)
    errors: list[dict[str, Any]] = [
        {"where": ".".join(map(str, item["loc"])), "message": item["msg"]}
        for item in error.errors()
    ]
    first = errors[0] if errors else {"where": "request", "message": "not valid"}
    return problem(
        422,
        "invalid_request",
        f"{first['where']}: {first['message']}.",
        members={"errors": errors, "remedy": "See /docs for the parameters of this call."},
    )


async def _on_http_exception(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)  # noqa: S101 (registered for this type alone)
    code = HTTPStatus(error.status_code).phrase.lower().replace(" ", "_").replace("-", "_")
    detail = error.detail
    if detail == HTTPStatus(error.status_code).phrase:
        detail = f"{detail}: {request.method} {request.url.path}"
    return problem(error.status_code, code, detail, headers=error.headers)


async def _on_unexpected(request: Request, error: Exception) -> Response:
    logger.error("%s %s failed", request.method, request.url.path, exc_info=error)
    return problem(
        500,
        "internal_error",
        "The server failed on this request; the fault is ours.",
        members={"remedy": "Try again, and report it with the time if it comes back."},
    )
