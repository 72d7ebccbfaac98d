"""Types of a JSON schema in words."""

from __future__ import annotations

import html
from typing import Any, Final

_SIGNS: Final = (
    ("exclusiveMinimum", ">"),
    ("minimum", "≥"),
    ("exclusiveMaximum", "<"),
    ("maximum", "≤"),
)
_SIZES: Final = (("minLength", "maxLength", "characters"), ("minItems", "maxItems", "items"))


def describe_type(schema: dict[str, Any]) -> str:
    """Say in HTML what a schema allows; named schemas as links within the page."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f'<a href="#schema-{html.escape(name)}">{html.escape(name)}</a>'
    for together in ("anyOf", "oneOf", "allOf"):
        if together in schema:
            parts = [describe_type(part) for part in schema[together]]
            return " or ".join(dict.fromkeys(parts))
    if "const" in schema:
        return f"<code>{html.escape(str(schema['const']))}</code>"
    if "enum" in schema:
        values = (f"<code>{html.escape(str(value))}</code>" for value in schema["enum"])
        return ", ".join(values)
    kind = schema.get("type", "anything")
    if kind == "array":
        return f"list of {describe_type(schema.get('items', {}))}{_bounds(schema)}"
    if kind == "object" and isinstance(schema.get("additionalProperties"), dict):
        return f"names to {describe_type(schema['additionalProperties'])}"
    if schema.get("format") == "binary":
        kind = "bytes"
    return html.escape(str(kind)) + _bounds(schema)


def describe_default(schema: dict[str, Any]) -> str:
    """Write the default in HTML."""
    default = schema.get("default")
    if default is None or default == "":
        return ""
    return f"; <code>{html.escape(str(default))}</code> if absent"


def without_null(schema: dict[str, Any]) -> dict[str, Any]:
    """Leave null out of a parameter's types: a query has no null."""
    kinds = [part for part in schema.get("anyOf", ()) if part.get("type") != "null"]
    return {**schema, "anyOf": kinds} if kinds else schema


def _bounds(schema: dict[str, Any]) -> str:
    bounds = [f"{sign} {schema[name]}" for name, sign in _SIGNS if name in schema]
    for least, most, what in _SIZES:
        if schema.get(least) and most in schema:
            bounds.append(f"{schema[least]} to {schema[most]} {what}")
        elif schema.get(least):
            bounds.append(f"at least {schema[least]} {what}")
        elif most in schema:
            bounds.append(f"at most {schema[most]} {what}")
    if pattern := schema.get("pattern"):
        bounds.append(f"<code>{html.escape(pattern)}</code>" if len(pattern) < 50 else "patterned")
    return f", {', '.join(bounds)}" if bounds else ""
