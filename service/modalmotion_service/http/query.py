"""Query parameters of a frequent call: read once for all requests that repeat them."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import lru_cache
from typing import Any, Final, TypeVar

from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ValidationError
from starlette.datastructures import QueryParams
from starlette.requests import Request

from modalmotion_service.access.principal import principal_of

Query = TypeVar("Query", bound=BaseModel)

# Longer ones state their own times, and are seldom repeated.
_LONGEST_KEPT: Final = 2000


def read_once(model: type[Query]) -> Callable[[Request], Awaitable[Query]]:
    """Make the dependency that reads the query of a request as a model.

    Requests share its result, which must not be changed. FastAPI takes 0.2 ms for the
    thirty parameters of a signature, each time; a cohort's requests differ in their bodies alone.

    Parameters
    ----------
    model : type of BaseModel
    """

    def read(owner: str | None, text: bytes) -> Query:  # noqa: ARG001 (a part of the cache's key)
        try:
            return model.model_validate(dict(QueryParams(text)))
        except ValidationError as error:
            raise RequestValidationError(
                [{**item, "loc": ("query", *item["loc"])} for item in error.errors()]
            ) from error

    cached = lru_cache(maxsize=256)(read)

    async def query_of(request: Request) -> Query:
        text: bytes = request.scope["query_string"]
        # Each owner's by itself: the time that it takes tells nobody what others ask.
        principal = principal_of(request.scope)
        owner = None if principal is None else principal.owner
        return (cached if len(text) <= _LONGEST_KEPT else read)(owner, text)

    return query_of


def described(model: type[BaseModel]) -> list[dict[str, Any]]:
    """Describe the parameters that `read_once` reads, as FastAPI describes those it reads."""
    schemas = model.model_json_schema(ref_template="#/components/schemas/{model}")["properties"]
    return [_parameter(name, "query", schema) for name, schema in schemas.items()]


def header(name: str, default: str, description: str, **limits: int) -> dict[str, Any]:
    """Describe a header that a handler reads by itself, beside parameters so described."""
    schema = {"type": "string", **limits, "description": description, "default": default}
    return _parameter(name, "header", schema)


def _parameter(name: str, place: str, schema: dict[str, Any]) -> dict[str, Any]:
    shown = {key: value for key, value in schema.items() if key != "default" or value is not None}
    if "$ref" not in shown:
        shown.setdefault("title", name.replace("_", " ").title())
    described = {"name": name, "in": place, "required": False, "schema": shown}
    if "description" in shown:
        described["description"] = shown["description"]
    return described
