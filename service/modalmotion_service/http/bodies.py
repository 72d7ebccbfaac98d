"""JSON bodies: read and checked at once, large ones apart from the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, Final, TypeVar

from fastapi import Request
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ValidationError

Body = TypeVar("Body", bound=BaseModel)

# A millisecond or two for whoever reads it at once.
_SMALL_BYTES: Final = 64_000


def body_of(
    model: type[Body], *, is_optional: bool = False
) -> Callable[[Request], Awaitable[Body]]:
    """Make the dependency that reads the JSON body of a request.

    Parameters
    ----------
    model : type of BaseModel
    is_optional : bool
        Whether an empty body, or null, states nothing.
    """

    async def read(request: Request) -> Body:
        data = await request.body()
        if is_optional and data.strip() in (b"", b"null"):
            data = b"{}"
        if len(data) <= _SMALL_BYTES:
            return checked(model, data, "body")
        return await asyncio.to_thread(checked, model, data, "body")

    return read


def checked(model: type[Body], data: bytes | str | dict[str, Any], where: str) -> Body:
    """Read JSON, or check values, as a model.

    Raises
    ------
    RequestValidationError
        If it does not fit; names the place within `where`.
    """
    try:
        if isinstance(data, dict):
            return model.model_validate(data)
        return model.model_validate_json(data)
    except ValidationError as error:
        found = error.errors(include_input=False, include_url=False, include_context=True)
        raise RequestValidationError(
            [{**item, "loc": (where, *item["loc"])} for item in found]
        ) from None
