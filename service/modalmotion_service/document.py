"""The OpenAPI document: what the framework makes of routes, with scopes and examples, shorter."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from modalmotion_service.access.scopes import SCOPE_OF, Scope

OCTETS: Final = "application/octet-stream"
"""Media type that any file may be taken as."""


def is_file(media_type: str) -> bool:
    """Return whether a media type is neither text nor JSON."""
    return not (media_type.startswith("text/") or media_type.endswith("json"))


_SCHEMES: Final = {
    "bearer": {
        "type": "http",
        "scheme": "bearer",
        "description": "A key made by `modalmotion keys create`. Over loopback none is needed "
        "unless the settings require one.",
    },
    "header": {"type": "apiKey", "in": "header", "name": "X-API-Key", "description": "The same."},
}
_PROBLEM: Final = {"application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}}


def completed(
    document: dict[str, Any],
    bodies: Sequence[type[BaseModel]],
    problem: type[BaseModel],
    examples: Mapping[str, Any],
) -> dict[str, Any]:
    """Add to an OpenAPI document, which is changed, what the framework does not know.

    Keys and scopes; bodies that routes read themselves; problems, once for all calls; names of
    calls that are names of functions in generated clients, such as `upload_sequence`; files as
    streams of octets, which generators know; examples.

    Parameters
    ----------
    document : dict
    bodies : sequence of type of BaseModel
    problem : type of BaseModel
    examples : mapping
        Of bodies, by the name of their model, and of parameters of paths.
    """
    _, made = models_json_schema(
        [(one, "validation") for one in dict.fromkeys(bodies)],
        ref_template="#/components/schemas/{model}",
    )
    schemas = document["components"]["schemas"]
    schemas |= made["$defs"] | {"Problem": problem.model_json_schema(mode="serialization")}
    for name in ("HTTPValidationError", "ValidationError"):
        schemas.pop(name, None)
    for name, schema in schemas.items():
        if name in examples:
            schema["examples"] = [examples[name]]
    document["components"] |= {
        "securitySchemes": _SCHEMES,
        "responses": {"Problem": {"description": "A problem, by its code.", "content": _PROBLEM}},
    }
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            _complete(operation, method, path, examples)
    # An empty requirement: none is needed over loopback.
    document["security"] = [{"bearer": []}, {"header": []}, {}]
    shortened: dict[str, Any] = _shortened(document)
    return shortened


def _complete(
    operation: dict[str, Any], method: str, path: str, examples: Mapping[str, Any]
) -> None:
    # The framework's is the function's, the path's and the method's.
    operation["operationId"] = operation["operationId"].removesuffix(
        re.sub(r"\W", "_", path) + f"_{method}"
    )
    responses = operation["responses"]
    for status in [status for status in responses if status >= "400"]:
        del responses[status]
    for answer in responses.values():
        content = answer.get("content", {})
        if any(map(is_file, content)) and not any(one.endswith("json") for one in content):
            # What most generators of clients know a file by.
            content.setdefault(OCTETS, content[next(filter(is_file, content))])
    scope = SCOPE_OF.get((method.upper(), path), Scope.ADMIN)
    responses["default"] = {"$ref": "#/components/responses/Problem"}
    for parameter in operation.get("parameters", ()):
        if parameter["in"] == "path" and parameter["name"] in examples:
            parameter["example"] = examples[parameter["name"]]
    if scope is None:
        operation["security"] = []
        return
    operation["x-scope"] = scope


def _shortened(value: Any) -> Any:
    """Leave out what says nothing: titles of fields, null as a default, words for programmers."""
    if isinstance(value, list):
        return [_shortened(one) for one in value]
    if not isinstance(value, dict):
        return value
    short = {
        name: _words(one) if name == "description" and isinstance(one, str) else _shortened(one)
        for name, one in value.items()
        if not (name == "title" and isinstance(one, str) and "version" not in value)
        and not (name == "default" and one is None)
    }
    match short.get("anyOf"):
        case [{"type": str(kind), **rest}, {"type": "null"}] if not {"enum", "const"} & rest.keys():
            del short["anyOf"]
            short |= {**rest, "type": [kind, "null"]}
    return short


def _words(text: str) -> str:
    """Leave out what a docstring says to programmers, and ends of lines within a paragraph."""
    text = text.partition("\n\nParameters\n")[0].partition("\n\nRaises\n")[0]
    return re.sub(r"(?<!\n)\n(?!\n)", " ", text)
