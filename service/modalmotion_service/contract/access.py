"""What the OpenAPI document says of each call: its scope, its refusals, its name, its files."""

from __future__ import annotations

import re
from typing import Any, Final

from modalmotion_service.access.scopes import SCOPE_OF, Scope
from modalmotion_service.contract.files import OCTETS, is_file

_SCHEMES: Final = {
    "bearer": {
        "type": "http",
        "scheme": "bearer",
        "description": "A key made by `modalmotion keys create`. Over loopback none is needed "
        "unless the settings say so.",
    },
    "header": {"type": "apiKey", "in": "header", "name": "X-API-Key", "description": "The same."},
}

_PROBLEM: Final = {"application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}}
_REFUSALS: Final = {
    "401": {
        "description": "No key, or none that is valid.",
        "headers": {"WWW-Authenticate": {"schema": {"type": "string"}}},
        "content": _PROBLEM,
    },
    "403": {"description": "The key lacks the scope.", "content": _PROBLEM},
    "429": {
        "description": "More requests than may come in a minute, or be under way at once.",
        "headers": {"Retry-After": {"schema": {"type": "string"}}},
        "content": _PROBLEM,
    },
}


def with_access(document: dict[str, Any]) -> dict[str, Any]:
    """Add to an OpenAPI document, which is changed, what the framework does not know.

    Keys and scopes; names of calls that are names of functions in generated clients, such as
    `sequences_upload`; files as streams of octets, which generators know.

    Parameters
    ----------
    document : dict
    """
    document.setdefault("components", {})["securitySchemes"] = _SCHEMES
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            # The framework's is the function's, the path's and the method's.
            name = operation["operationId"].removesuffix(re.sub(r"\W", "_", path) + f"_{method}")
            operation["operationId"] = (
                f"{re.sub(r'[^a-z0-9]+', '_', operation['tags'][0].lower())}_{name}"
            )
            for status, answer in operation["responses"].items():
                if status >= "400":
                    # Every error is a problem, not what the framework makes of it.
                    answer["content"] = _PROBLEM
                    continue
                if answer["description"] == "Successful Response":
                    answer["description"] = "The requested content."
                content = answer.get("content", {})
                if any(map(is_file, content)) and not any(one.endswith("json") for one in content):
                    # What most generators of clients know a file by.
                    content.setdefault(OCTETS, content[next(filter(is_file, content))])
            scope = SCOPE_OF.get((method.upper(), path), Scope.ADMIN)
            if scope is None:
                operation["security"] = []
                operation["responses"].setdefault("429", _REFUSALS["429"])
                continue
            # An empty requirement: none is needed over loopback.
            operation["security"] = [{"bearer": [scope]}, {"header": [scope]}, {}]
            operation["x-scope"] = scope
            operation["responses"].update(_REFUSALS)
    return document
