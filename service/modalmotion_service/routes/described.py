"""How calls are described: bodies, uploads and answers, the same way for all."""

from __future__ import annotations

from typing import Any, Final

from pydantic import BaseModel

from modalmotion_service.document import is_file
from modalmotion_service.http.negotiation import FHIR, JSON
from modalmotion_service.schemas.general import JobAnswer

ACCEPTED: Final[dict[int | str, dict[str, Any]]] = {
    202: {"model": JobAnswer, "description": "Continued as a job; fetch the result later."}
}

_BINARY: Final = {"schema": {"type": "string", "format": "binary"}}
_TEXT: Final = {"schema": {"type": "string"}}
_OBJECT: Final = {"schema": {"type": "object"}}


def answers(
    *media_types: str,
    of: Any = None,
    status: int = 200,
    is_new: bool = False,
    waits: bool = True,
    **extra: Any,
) -> dict[str, Any]:
    """Describe the answers of a call, for the router.

    Parameters
    ----------
    *media_types : str
        That it is given as.
    of : type, optional
        Model of JSON.
    status : int
        Of an answer at once.
    is_new : bool
        Whether 201 says that something was made, and 200 that it was known.
    waits : bool
        Whether it may become a job.
    **extra
        As of `body` and `upload`.
    """
    content = {
        kind: _OBJECT if kind == FHIR else _BINARY if is_file(kind) else _TEXT
        for kind in media_types
        if kind != JSON
    }
    first: dict[str, Any] = {"description": "The requested content."}
    if content:
        first["content"] = content
    responses: dict[int | str, dict[str, Any]] = {201 if is_new else status: first}
    if is_new:
        responses[200] = {"model": of, **first, "description": "Known already."}
    made: dict[str, Any] = {
        "status_code": 201 if is_new else status,
        "response_model": of,
        "responses": {**responses, **(ACCEPTED if waits else {})},
    }
    if of is None:
        from starlette.responses import Response

        made |= {"response_class": Response, "response_model": None}
    return made | extra


def body(model: type[BaseModel], *, is_optional: bool = False) -> dict[str, Any]:
    """Describe a JSON body that `body_of` reads."""
    content = {JSON: {"schema": {"$ref": f"#/components/schemas/{model.__name__}"}}}
    described = {"content": content, "required": not is_optional}
    return {"openapi_extra": {"requestBody": described}}


def upload(
    model: type[BaseModel], *, many: bool = False, is_optional: bool = False
) -> dict[str, Any]:
    """Describe an upload with statements in the query, in fields of a form, or as JSON in it.

    Parameters
    ----------
    model : type of BaseModel
        Of the statements.
    many : bool
        Whether it may be many files.
    is_optional : bool
        Whether something else may stand in place of a file.
    """
    statements = {"$ref": f"#/components/schemas/{model.__name__}"}
    file = {"type": "string", "format": "binary"}
    properties: dict[str, Any] = {"file": file, "parameters": statements}
    if many:
        properties |= {"files": {"type": "array", "items": file}, "manifest": {"type": "string"}}
    form = {"type": "object", "properties": properties}
    if not many and not is_optional:
        form["required"] = ["file"]
    content = {
        "application/octet-stream": {"schema": file},
        "multipart/form-data": {
            "schema": form,
            "encoding": {"parameters": {"contentType": JSON}},
        },
    }
    query = {
        "name": "parameters",
        "in": "query",
        "required": False,
        "style": "form",
        "explode": True,
        "schema": statements,
        "description": "Each by its name, over those of a form; a list as 1,2,3.",
    }
    return {
        "openapi_extra": {
            "requestBody": {"required": not is_optional, "content": content},
            "parameters": [query],
        }
    }
