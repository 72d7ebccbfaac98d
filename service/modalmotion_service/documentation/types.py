"""Types of a JSON schema in words."""

from __future__ import annotations

import html
from typing import Any, Final

_BOUNDS: Final = (
    ("exclusiveMinimum", ">", ""),
    ("minimum", "≥", ""),
    ("exclusiveMaximum", "<", ""),
    ("maximum", "≤", ""),
    ("minLength", "≥", " characters"),
    ("maxLength", "≤", " characters"),
    ("minItems", "≥", " items"),
    ("maxItems", "≤", " items"),
)


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
    """Say in HTML what is taken where nothing is given."""
    default = schema.get("default")
    if default is None:
        return ""
    return f"; <code>{html.escape(str(default))}</code> if absent"


def _bounds(schema: dict[str, Any]) -> str:
    told = [f"{sign} {schema[name]}{unit}" for name, sign, unit in _BOUNDS if schema.get(name)]
    if schema.get("minimum") == 0:
        told.insert(0, "≥ 0")
    if pattern := schema.get("pattern"):
        told.append(f"<code>{html.escape(pattern)}</code>" if len(pattern) < 50 else "patterned")
    return f", {', '.join(told)}" if told else ""
