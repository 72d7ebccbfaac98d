"""Parts of the OpenAPI document that several routes share."""

from __future__ import annotations

from typing import Any, Final

from pydantic import BaseModel

from modalmotion.facts import NAMES
from modalmotion_service.schemas import JobAnswer

PREFER: Final = "respond-async for a job, or wait=SECONDS."
"""What a header Prefer may say."""

BINARY: Final = {"schema": {"type": "string", "format": "binary"}}


TEXT: Final = {"schema": {"type": "string"}}


def _upload_body(*names: str) -> dict[str, Any]:
    """Describe the body of an upload, whose form may have fields of these names beside facts."""
    also = f" ({' and '.join(names)} too)" if names else ""
    fields = (*names, *NAMES)
    schema = {
        "type": "object",
        "required": ["file"],
        "properties": {
            "file": {"type": "string", "format": "binary"},
            **{name: {"type": "string"} for name in fields},
        },
    }
    return {
        "requestBody": {
            "required": True,
            "description": "The file's bytes, or a form with one part named 'file' and "
            f"fields that state facts: by name as in the query, or landmark:apex and "
            f"covariate:age{also}. Other fields are refused.",
            "content": {
                "application/octet-stream": BINARY,
                "multipart/form-data": {"schema": schema},
            },
        }
    }


def _many_files_body(single: dict[str, Any]) -> dict[str, Any]:
    """Describe the body of a call that takes one file or many.

    Parameters
    ----------
    single : dict
        What it is for one.
    """
    body = single["requestBody"]
    form = body["content"]["multipart/form-data"]["schema"]
    properties = {
        **form["properties"],
        "files": {"type": "array", "items": {"type": "string", "format": "binary"}},
        "manifest": {"type": "string"},
    }
    many = {"type": "object", "properties": properties}
    return {
        "requestBody": {
            **body,
            "description": f"{body['description']} Or a form with many parts named 'files', "
            "answered by a list with a result or a problem for each; facts that stand in the form "
            "are those of all, and a part 'manifest', a CSV table with the columns path, subject, "
            "label and facts, says those of each.",
            "content": {**body["content"], "multipart/form-data": {"schema": many}},
        }
    }


UPLOAD_BODY: Final = _upload_body()
MANY_FILES_BODY: Final = _many_files_body(UPLOAD_BODY)
NAMED_UPLOAD_BODY: Final = _upload_body("subject", "label")

FILE_BODY: Final[dict[str, Any]] = {
    "requestBody": {
        "required": True,
        "description": "The file's bytes, or a form with one part named 'file' and no other field.",
        "content": {
            "application/octet-stream": BINARY,
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["file"],
                    "properties": {"file": {"type": "string", "format": "binary"}},
                }
            },
        },
    }
}

_PROBLEM_CONTENT: Final = {
    "application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}
}

# Without the model: the framework would build a serialiser of it for each of 540 answers.
PROBLEMS: Final[dict[int | str, dict[str, Any]]] = {
    status: {"description": text, "content": _PROBLEM_CONTENT}
    for status, text in {
        400: "The bytes are not a readable file.",
        404: "Nothing is stored under that id.",
        408: "The request's body came too slowly.",
        409: "The present state does not allow it.",
        413: "Larger than a limit.",
        422: "The content or a parameter cannot be used; names frame, vertex and remedy.",
        429: "Too many requests or jobs.",
        503: "The result cannot be stored at the moment.",
        507: "The disk is full.",
    }.items()
}

ACCEPTED: Final[dict[int | str, dict[str, Any]]] = {
    202: {
        "model": JobAnswer,
        "description": "Continued as a job; fetch the result later.",
    }
}


def schema_of(model: type[BaseModel]) -> dict[str, Any]:
    """Give the schema of a body that a route reads by itself, without references."""
    whole = model.model_json_schema()
    parts = whole.pop("$defs", {})

    def resolved(value: Any) -> Any:
        if isinstance(value, dict):
            if "$ref" in value:
                return resolved(parts[value["$ref"].rpartition("/")[2]])
            return {name: resolved(one) for name, one in value.items()}
        return [resolved(one) for one in value] if isinstance(value, list) else value

    found: dict[str, Any] = resolved(whole)
    return found
