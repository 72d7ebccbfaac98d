"""Routes that the gate must have checked, and whose query and body are checked and described."""

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from typing import Any, Final, TypeVar

from fastapi import APIRouter, Depends, Request
from fastapi.dependencies.models import Dependant
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from pydantic import BaseModel, ValidationError

from modalmotion_service.http.gate import require_gate
from modalmotion_service.http.negotiation import JSON

Body = TypeVar("Body", bound=BaseModel)

# A millisecond or two for whoever reads it at once.
_SMALL_BYTES: Final = 64_000


def body_of(model: type[Body]) -> Callable[[Request], Awaitable[Body]]:
    """Make the dependency that reads the JSON body of a request, which may be empty or null.

    Parameters
    ----------
    model : type of BaseModel
        Where all of it may be left out, so may the body.
    """
    is_optional = not any(field.is_required() for field in model.model_fields.values())

    async def read(request: Request) -> Body:
        data = await request.body()
        if is_optional and data.strip() in (b"", b"null"):
            data = b"{}"
        if len(data) <= _SMALL_BYTES:
            return checked(model, data, "body")
        return await asyncio.to_thread(checked, model, data, "body")

    content = {JSON: {"schema": described_as(model)}}
    described = {"requestBody": {"content": content, "required": not is_optional}}
    read.described = described  # type: ignore[attr-defined]
    return read


BODIES: Final[list[type[BaseModel]]] = []
"""Models that bodies and statements of calls are read as."""


def described_as(model: type[BaseModel]) -> dict[str, str]:
    """Refer to a model in the document, which has it then."""
    BODIES.append(model)
    return {"$ref": f"#/components/schemas/{model.__name__}"}


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


# Names that the query of a route may have, kept with it.
_KNOWN: Final = "known_query"
# Calls that have no parameters, by the one that has.
_ELSEWHERE: Final = {
    "/v1/sequences/{sequence_id}/signature": "This is the usual signature, of 7 modes. For others "
    'send JSON such as {"modes": 12} to POST /v1/sequences/{id}/signatures.',
}


async def require_known(request: Request) -> None:
    """Refuse parameters that the call does not know: they would be dropped.

    Raises
    ------
    RequestValidationError
        If there is one.
    """
    query = request.query_params
    if query:
        of_route = request.scope["route"].__dict__
        if _KNOWN not in of_route:
            of_route[_KNOWN] = frozenset(_names(of_route["dependant"]))
        known = of_route[_KNOWN]
        unknown = [name for name in query if name not in known]
        if unknown:
            remedy = _ELSEWHERE.get(request.scope["route"].path)
            raise invalid("Extra inputs are not permitted", "query", *unknown, remedy=remedy)


def invalid(
    message: str, where: str, *names: str, remedy: str | None = None
) -> RequestValidationError:
    """Make the error of parameters in a query, a form or a body that are not valid."""
    about = {"type": "invalid", "msg": message, "ctx": {"remedy": remedy}}
    return RequestValidationError([{**about, "loc": (where, name[:80])} for name in names])


def _names(dependant: Dependant) -> Iterator[str]:
    models = [getattr(dependant.call, "query_model", None)]
    for one in dependant.query_params:
        kind = one.field_info.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            models.append(kind)
        else:
            yield one.alias
    for model in models:
        yield from () if model is None else model.model_fields
    for part in dependant.dependencies:
        yield from _names(part)


class GatedRouter(APIRouter):
    """Router of which every route requires the gate's check, and refuses unknown parameters.

    The first line of a handler's documentation is the summary of its call, the rest describes it.

    An application takes its routes as they are. Of a router that is included in another the
    framework makes every route again, at the first request that looks for one: a third of a
    second.

    Parameters
    ----------
    **options
        As of the framework's router.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(dependencies=[Depends(require_gate), Depends(require_known)], **options)

    def add_api_route(self, path: str, endpoint: Callable[..., Any], **options: Any) -> None:
        """Add a route with its documentation."""
        first, _, rest = (endpoint.__doc__ or "").strip().partition("\n")
        options["summary"] = options.get("summary") or first.rstrip(".")
        options["description"] = options.get("description") or "\n".join(
            line.removeprefix("    ") for line in rest.strip().splitlines()
        )
        super().add_api_route(path, endpoint, **options)
        route = self.routes[-1]
        assert isinstance(route, APIRoute)  # noqa: S101 (it was made just now)
        for part in route.dependant.dependencies:
            route.openapi_extra = getattr(part.call, "described", route.openapi_extra)
