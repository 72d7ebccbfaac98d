"""Writes the calls of the HTTP interface as a page of the site, from openapi/openapi.json."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

_Node = dict[str, Any]


def http_reference(document: _Node) -> str:
    """Write a page in Markdown: each call with its parameters, its body and its answers."""
    by_tag: dict[str, list[str]] = {}
    for path, calls in document["paths"].items():
        for method, call in calls.items():
            tag = call.get("tags", ["other"])[0]
            by_tag.setdefault(tag, []).extend(_call(document, f"{method.upper()} {path}", call))
    lines = ["# Calls", "", f"Version {document['info']['version']} of the interface."]
    for tag, of_tag in by_tag.items():
        lines += ["", f"## {tag.capitalize()}", *of_tag]
    return "\n".join(lines) + "\n"


def _call(document: _Node, name: str, call: _Node) -> Iterator[str]:
    yield from ("", f"### `{name}`", "", f"**{call['summary']}**.")
    if call.get("description", "").rstrip(".") != call["summary"]:
        yield from ("", call.get("description", ""))
    if "x-scope" in call:
        yield from ("", f"Scope of the key: `{call['x-scope']}`.")
    rows = []
    for own in call.get("parameters", []):
        one = _resolved(document, own)
        rows.append((f"`{one['name']}`", one["in"], one["schema"], one.get("description", "")))
    for media, content in call.get("requestBody", {}).get("content", {}).items():
        schema = _resolved(document, content.get("schema", {}))
        place = {"application/json": "body", "multipart/form-data": "form"}.get(media, media)
        for member, of_member in schema.get("properties", {}).items():
            rows.append((f"`{member}`", place, of_member, of_member.get("description", "")))
    if rows:
        yield from ("", "| name | in | type | description |", "|---|---|---|---|")
    for member, place, schema, text in rows:
        yield f"| {member} | {place} | {_type(document, schema)} | {_cell(text)} |"
    yield ""
    for status, own in call["responses"].items():
        answer = _resolved(document, own)
        media = ", ".join(f"`{one}`" for one in answer.get("content", {})) or "nothing"
        yield f"- {status}: {media}. {answer.get('description', '')}"


def _resolved(document: _Node, node: _Node) -> _Node:
    while "$ref" in node:
        found = document
        for name in node["$ref"].removeprefix("#/").split("/"):
            found = found[name]
        node = found
    return node


def _type(document: _Node, schema: _Node) -> str:
    """Name what a schema allows; of a choice, each."""
    if "enum" in (named := _resolved(document, schema)):
        return ", ".join(f"`{value}`" for value in named["enum"])
    if "$ref" in schema:
        return str(schema["$ref"].rpartition("/")[2])
    if choices := schema.get("anyOf") or schema.get("oneOf"):
        return " or ".join(_type(document, one) for one in choices)
    types = schema.get("type", "any")
    of_items = f" of {_type(document, schema['items'])}" if "items" in schema else ""
    names = [types] if isinstance(types, str) else types
    return " or ".join(f"array{of_items}" if name == "array" else name for name in names)


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
