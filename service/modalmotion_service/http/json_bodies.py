"""JSON bodies read apart from the event loop, so that nobody else waits for a large one.

json.loads holds the interpreter until it is done: 10 MB with a million keys are a second, in a
thread as well. So a large body is read by a loop of our own, in a thread, which others
interrupt, and which ends at the first object with more members than any request has.
"""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Callable, Coroutine
from json import decoder
from typing import Any, Final

from fastapi import Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from pydantic import BaseModel, ValidationError

from modalmotion.errors import LimitError, MalformedFileError

# A millisecond or two for whoever reads it at once.
_SMALL_BYTES: Final = 64_000

MOST_MEMBERS: Final = 100
"""Of one object in a large body: requests have up to thirty."""

DEEPEST: Final = 20
"""Objects and lists within each other."""

MOST_VALUES: Final = 1_000_000
"""Names and values: a training on as many sequences as are taken has 700,000."""

# The C function that json itself reads texts with.
_read_text: Final[Any] = vars(decoder)["scanstring"]
_BLANKS: Final = re.compile(r"[ \t\n\r]*")
_LITERAL: Final = re.compile(r"-?[0-9][0-9.eE+-]{0,400}|true|false|null|NaN|-?Infinity")

Handler = Callable[[Request], Coroutine[Any, Any, Response]]


class JsonRoute(APIRoute):
    """A route whose large JSON bodies are read and checked in a thread."""

    def get_route_handler(self) -> Handler:
        """Make the handler: FastAPI's own, which is given the body as it was read."""
        answer = super().get_route_handler()
        model = None if self.body_field is None else self.body_field.field_info.annotation
        if not (isinstance(model, type) and issubclass(model, BaseModel)):
            return answer

        async def handler(request: Request) -> Response:
            request = _ReadRequest(request.scope, request.receive)
            body = await request.body()
            if len(body) > _SMALL_BYTES and _is_json(request):
                request.value = await asyncio.to_thread(_checked, body, model)
            return await answer(request)

        return handler


class _ReadRequest(Request):
    """A request whose JSON may have been read already."""

    value: BaseModel | None = None

    async def json(self) -> Any:
        return await super().json() if self.value is None else self.value


def _is_json(request: Request) -> bool:
    kind = request.headers.get("content-type", "application/json")
    return "json" in kind.partition(";")[0].lower()


def _checked(body: bytes, model: type[BaseModel]) -> BaseModel:
    try:
        return model.model_validate(parse_json(body))
    except ValidationError as error:
        errors = error.errors(include_input=False, include_url=False)
        raise RequestValidationError(
            [{**item, "loc": ("body", *item["loc"])} for item in errors]
        ) from None


def parse_json(body: bytes) -> Any:
    """Read JSON as `json.loads` does, but for its limits, and letting other threads run.

    Parameters
    ----------
    body : bytes

    Raises
    ------
    RequestValidationError
        If it is not JSON.
    MalformedFileError
        If it is not text.
    LimitError
        If it has more than `MOST_VALUES`, an object of more than `MOST_MEMBERS`, or is more than
        `DEEPEST` deep.
    """
    try:
        text = body.decode(json.detect_encoding(body), "surrogatepass")
        value, end = _Reader(text).value(_after_blanks(text, 0), 0)
        _require_end(text, _after_blanks(text, end))
    except json.JSONDecodeError as error:
        raise RequestValidationError(
            [
                {
                    "type": "json_invalid",
                    "loc": ("body", error.pos),
                    "msg": "JSON decode error",
                    "input": {},
                    "ctx": {"error": error.msg},
                }
            ]
        ) from None
    except UnicodeDecodeError as error:
        raise MalformedFileError(
            "The request's body is not text in UTF-8.", remedy="Send JSON in UTF-8."
        ) from error
    return value


class _Reader:
    """Reads values from a text, each with the place behind it."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.n_values = 0

    def value(self, at: int, depth: int) -> tuple[Any, int]:
        self.n_values += 1
        if self.n_values > MOST_VALUES:
            raise _too_much("json_values", f"has more than {MOST_VALUES} values", MOST_VALUES)
        first = self.text[at : at + 1]
        if first == '"':
            read: tuple[str, int] = _read_text(self.text, at + 1)
            return read
        if first in ("{", "["):
            if depth == DEEPEST:
                raise _too_much("json_depth", f"is more than {DEEPEST} deep", DEEPEST)
            return (self._members if first == "{" else self._items)(at + 1, depth + 1)
        match = _LITERAL.match(self.text, at)
        if match is None:
            raise json.JSONDecodeError("Expecting value", self.text, at)
        return json.loads(match[0]), match.end()

    def _items(self, at: int, depth: int) -> tuple[list[Any], int]:
        items: list[Any] = []
        at = _after_blanks(self.text, at)
        if self.text[at : at + 1] == "]":
            return items, at + 1
        is_last = False
        while not is_last:
            item, at = self.value(at, depth)
            items.append(item)
            at, is_last = self._next(at, "]")
        return items, at

    def _members(self, at: int, depth: int) -> tuple[dict[str, Any], int]:
        members: dict[str, Any] = {}
        at = _after_blanks(self.text, at)
        if self.text[at : at + 1] == "}":
            return members, at + 1
        # Counted as they come: one name may come a million times.
        for _ in range(MOST_MEMBERS):
            if self.text[at : at + 1] != '"':
                raise json.JSONDecodeError("Expecting property name", self.text, at)
            name, at = self.value(at, depth)
            at = _after_blanks(self.text, at)
            if self.text[at : at + 1] != ":":
                raise json.JSONDecodeError("Expecting ':' delimiter", self.text, at)
            members[name], at = self.value(_after_blanks(self.text, at + 1), depth)
            at, is_last = self._next(at, "}")
            if is_last:
                return members, at
        what = f"has an object of more than {MOST_MEMBERS} members"
        raise _too_much("json_members", what, MOST_MEMBERS)

    def _next(self, at: int, end: str) -> tuple[int, bool]:
        at = _after_blanks(self.text, at)
        mark = self.text[at : at + 1]
        if mark == end:
            return at + 1, True
        if mark != ",":
            raise json.JSONDecodeError("Expecting ',' delimiter", self.text, at)
        return _after_blanks(self.text, at + 1), False


def _require_end(text: str, at: int) -> None:
    if at != len(text):
        raise json.JSONDecodeError("Extra data", text, at)


def _after_blanks(text: str, at: int) -> int:
    match = _BLANKS.match(text, at)
    return at if match is None else match.end()


def _too_much(limit: str, what: str, most: int) -> LimitError:
    return LimitError(
        f"The request's body {what}.",
        remedy="Send the members that /docs names, and no others.",
        limit=limit,
        details={"most": most},
    )
