"""How calls are described: bodies, uploads and answers, the same way for all."""

from __future__ import annotations

from typing import Any, Final

from pydantic import BaseModel

from modalmotion.classification import DEFAULT_MODEL
from modalmotion_service.document import is_file
from modalmotion_service.http.negotiation import FHIR, JSON
from modalmotion_service.schemas.general import JobAnswer

ACCEPTED: Final[dict[int | str, dict[str, Any]]] = {
    202: {"model": JobAnswer, "description": "Continued as a job; fetch the result later."}
}

BODIES: Final[list[type[BaseModel]]] = []
"""Models that bodies and statements of calls are read as."""

_ID: Final = "3f5c" * 16


EXAMPLES: Final[dict[str, Any]] = {
    "SequenceStatements": {"unit": "mm", "subject": "P-7", "cavity": "lv"},
    "SignatureRequest": {"modes": 18, "reference": "mean"},
    "SignatureOfFile": {"modes": 7, "unit": "mm"},
    "TradeRequest": {"tolerance": 0.5},
    "ManySignatures": {"ids": [_ID], "modes": 7},
    "EncodingOfFile": {"max_error": 0.5, "unit": "mm"},
    "ClassOfFile": {"model": DEFAULT_MODEL, "unit": "mm"},
    "TrackRequest": {"modes": 37, "landmarks": {"apex": [0, 0, -40], "base": [0, 0, 40]}},
    "SequenceChange": {"label": "rest", "facts": {"period": 0.8, "covariates": {"age": 61}}},
    "ClassificationRequest": {"model": DEFAULT_MODEL, "coverage": 0.95},
    "DecodingRequest": {"first": 2, "stop": 5},
    "TrainingRequest": {
        "name": "wall-motion",
        "sequences": [_ID, {"id": _ID, "label": "akinesia"}],
        "options": {"modes": 7},
    },
    "EvaluationRequest": {"sequences": [_ID], "compare_with": "wall-motion@1"},
    "NormRequest": {"name": "volunteers", "sequences": [_ID], "modes": 7},
    "DeviationRequest": {"sequences": [_ID], "level": 0.05},
    "FeaturesRequest": {"sequences": [_ID], "covariates": ["age"]},
    "sequence_id": _ID,
    "key": f"{_ID}-0a1b2c3d4e5f6071",
    "images_id": _ID,
    "track_id": _ID,
    "template_id": _ID,
    "job_id": "0a1b" * 8,
    "name": "wall-motion",
}

"""Of each body, by the name of its model; and of what is in a path."""

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
    BODIES.append(model)
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
        Whether something else may be in place of a file.
    """
    BODIES.append(model)
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
