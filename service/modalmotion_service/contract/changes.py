"""How much a change of the OpenAPI document means to clients: what its version must say."""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum
from typing import Any

Fact = tuple[str, ...]


class Change(IntEnum):
    """The number of a version that a change raises, counted from its end."""

    NONE = -1
    WORDS = 0
    ADDITION = 1
    BREAK = 2


def change_between(old: dict[str, Any], new: dict[str, Any]) -> tuple[Change, list[str]]:
    """Judge a change, and list what breaks or is added.

    Parameters
    ----------
    old, new : dict
        OpenAPI documents.
    """
    if _without_version(old) == _without_version(new):
        return Change.NONE, []
    promised, demanded = set(_promises(old)), set(_demands(old))
    gone = promised - set(_promises(new))
    needs = set(_demands(new)) - demanded
    # The needs of a new call break no client of an old one.
    needs = {fact for fact in needs if fact[:2] in {known[:2] for known in promised}}
    if gone or needs:
        words = [f"gone: {' '.join(fact)}" for fact in sorted(gone)]
        return Change.BREAK, words + [f"needed: {' '.join(fact)}" for fact in sorted(needs)]
    added = set(_promises(new)) - promised
    if added:
        return Change.ADDITION, [f"added: {' '.join(fact)}" for fact in sorted(added)]
    return Change.WORDS, []


def least_version(old: str, change: Change) -> str:
    """Give the lowest version that says what a change means, such as 1.3.0 after 1.2.5."""
    numbers = [int(number) for number in old.split(".")]
    if change is Change.NONE:
        return old
    place = 2 - change
    return ".".join(map(str, [*numbers[:place], numbers[place] + 1, *[0] * (2 - place)]))


def is_at_least(version: str, least: str) -> bool:
    """Compare two versions."""
    return _numbers(version) >= _numbers(least)


def _without_version(document: dict[str, Any]) -> dict[str, Any]:
    info = {name: value for name, value in document["info"].items() if name != "version"}
    return {**document, "info": info}


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(number) for number in version.split("."))


def _promises(document: dict[str, Any]) -> Iterator[Fact]:
    """List what clients may rely on: calls, parameters, types of contents, properties."""
    for call, operation in _calls(document):
        yield (*call, "is there")
        for parameter in _parameters(document, operation):
            yield (*call, "takes", parameter["in"], parameter["name"].lower())
        for kind in operation.get("requestBody", {}).get("content", {}):
            yield (*call, "takes", kind)
        for status, answer in operation["responses"].items():
            if status < "300":
                yield from ((*call, "gives", status, kind) for kind in answer.get("content", ["-"]))
    for name, schema in document["components"]["schemas"].items():
        for key, value in schema.get("properties", {}).items():
            yield ("schema", name, "has", key, _type(value))


def _demands(document: dict[str, Any]) -> Iterator[Fact]:
    """List what clients must do."""
    for call, operation in _calls(document):
        for parameter in _parameters(document, operation):
            if parameter.get("required"):
                yield (*call, "needs", parameter["name"])
        if operation.get("requestBody", {}).get("required"):
            yield (*call, "needs a body")
        yield (*call, "needs the scope", operation.get("x-scope", "none"))


def _parameters(document: dict[str, Any], operation: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for one in operation.get("parameters", ()):
        name = one.get("$ref", "").rpartition("/")[2]
        yield document["components"]["parameters"][name] if name else one


def _calls(document: dict[str, Any]) -> Iterator[tuple[tuple[str, str], dict[str, Any]]]:
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            yield (method.upper(), path), operation


def _type(schema: dict[str, Any]) -> str:
    if "$ref" in schema:
        return str(schema["$ref"]).rpartition("/")[2]
    parts = schema.get("anyOf") or schema.get("oneOf")
    if parts:
        return "|".join(sorted(map(_type, parts)))
    if "array" in schema.get("type", ""):
        return f"list of {_type(schema.get('items', {}))}"
    kinds = schema.get("type", "anything")
    return "|".join(sorted(kinds)) if isinstance(kinds, list) else str(kinds)
