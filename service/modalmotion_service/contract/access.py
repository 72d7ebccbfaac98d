"""Keys in the OpenAPI document: schemes, the scope of each call, its refusals."""

from __future__ import annotations

from typing import Any, Final

from modalmotion_service.access.scopes import SCOPE_OF, Scope

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
    """Add keys and scopes to an OpenAPI document, which is changed.

    Parameters
    ----------
    document : dict
    """
    document.setdefault("components", {})["securitySchemes"] = _SCHEMES
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            for status, answer in operation["responses"].items():
                if status >= "400":
                    # Every error is a problem, not what the framework makes of it.
                    answer["content"] = _PROBLEM
                elif answer["description"] == "Successful Response":
                    answer["description"] = "The requested content."
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
