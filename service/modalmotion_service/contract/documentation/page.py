"""The documentation page as HTML, from an OpenAPI document: no script, nothing from outside."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from typing import Any, Final

from modalmotion_service.contract.documentation.style import CSS
from modalmotion_service.contract.documentation.types import (
    describe_default,
    describe_type,
    without_null,
)

_SECTIONS: Final = {
    "sequences": "Sequences",
    "tracks": "Tracks",
    "signatures": "Modal signatures",
    "templates": "Templates",
    "codec": "Compression",
    "classifications": "Motion classes",
    "models": "Models",
    "norms": "Norms",
    "jobs": "Jobs",
    "limits": "Limits",
    "audit": "Audit",
    "health": "Health",
    "operation": "Operation",
}
_EXAMPLE: Final = {"application/json": "-H 'Content-Type: application/json' -d '{…}'"}


def render(document: dict[str, Any], base: str) -> str:
    """Write the page.

    Parameters
    ----------
    document : dict
        OpenAPI 3.1.
    base : str
        Address of the service, for the examples.
    """
    sections = _by_section(document)
    info = document["info"]
    parts = [
        "<!doctype html><html lang=en><head><meta charset=utf-8>",
        '<meta name=viewport content="width=device-width, initial-scale=1">',
        f"<title>{html.escape(info['title'])}: the HTTP interface</title>",
        f"<style>{CSS}</style></head><body><div class=page>",
        *_navigation(info, sections),
        "<main>",
        *_introduction(info, document, base),
    ]
    for title, calls in sections.items():
        parts.append(f'<h2 class=section id="{_slug(title)}">{html.escape(title)}</h2>')
        for path, method, operation in calls:
            parts.extend(_call(path, method, operation, base))
    parts.append("<h2 class=section id=schemas>Schemas</h2>")
    for name, schema in sorted(document["components"]["schemas"].items()):
        parts.extend(_schema(name, schema))
    parts.append("</main></div></body></html>")
    return "\n".join(parts)


Calls = dict[str, list[tuple[str, str, dict[str, Any]]]]


def _by_section(document: dict[str, Any]) -> Calls:
    sections: Calls = {}
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            tag = operation.get("tags", ["operation"])[0]
            sections.setdefault(_SECTIONS.get(tag, tag), []).append((path, method, operation))
    order = list(_SECTIONS.values())
    return dict(
        sorted(sections.items(), key=lambda item: (item[0] not in order, _at(order, item[0])))
    )


def _at(order: list[str], title: str) -> int:
    return order.index(title) if title in order else 0


def _navigation(info: dict[str, Any], sections: Calls) -> Iterator[str]:
    yield f'<nav aria-label=Calls><a class=title href="#top">{html.escape(info["title"])}</a>'
    for title, calls in sections.items():
        yield f"<h2>{html.escape(title)}</h2><ul>"
        for path, method, operation in calls:
            short = html.escape(operation.get("summary", path))
            yield f'<li><a href="#{_anchor(method, path)}">{short}</a></li>'
        yield "</ul>"
    yield '<h2>Reference</h2><ul><li><a href="#schemas">Schemas</a></li></ul></nav>'


def _introduction(info: dict[str, Any], document: dict[str, Any], base: str) -> Iterator[str]:
    yield f"<h1 id=top>{html.escape(info['title'])}</h1>"
    yield f"<p class=lead>{html.escape(info.get('summary', ''))}</p>"
    yield f"<p class=note>{html.escape(info.get('description', ''))}</p>"
    n_calls = sum(len(operations) for operations in document["paths"].values())
    yield (
        f"<p>Version {html.escape(info['version'])} of the interface, {n_calls} calls; as a file: "
        '<a href="openapi.json">openapi.json</a>.</p>'
    )
    yield (
        "<p>Send a key as <code>Authorization: Bearer KEY</code> (or <code>X-API-Key</code>); "
        "<code>modalmotion keys create</code> makes one. Over loopback none is needed unless the "
        "service is set to require one. Every call names the scope that its key must have.</p>"
    )
    yield (
        '<p>Errors are <a href="#schema-Problem">problems</a> (RFC 9457) that name the frame, '
        "the vertex, the limit and the remedy.</p>"
    )
    yield f"<pre>curl --data-binary @beat.npz {html.escape(base)}/v1/sequences</pre>"


def _call(path: str, method: str, operation: dict[str, Any], base: str) -> Iterator[str]:
    scope = operation.get("x-scope", "open")
    text = operation.get("description", "")
    what, _, more = text.partition("\n\n")
    shown = re.sub(r"\{(\w+)\}", r"<i>{\1}</i>", html.escape(path))
    yield (
        f'<details class=call id="{_anchor(method, path)}"><summary>'
        f"<span><span class='method {method}'>{method.upper()}</span><code>{shown}</code></span>"
        f"<span class=what>{html.escape(what)}</span>"
        f"<span class='scope {html.escape(scope)}'>{html.escape(scope)}</span></summary><div>"
    )
    if more:
        yield f"<p>{html.escape(more)}</p>"
    yield f"<pre>{html.escape(_curl(path, method, operation, base))}</pre>"
    if parameters := operation.get("parameters"):
        yield "<h4>Parameters</h4><table><tr><th>Name<th>In<th>Type<th>Meaning</tr>"
        for parameter in parameters:
            schema = without_null(parameter["schema"])
            words = parameter.get("description") or schema.get("description", "")
            yield _row(
                parameter["name"],
                parameter["in"],
                schema,
                words,
                is_required=parameter.get("required", False) and parameter["in"] != "path",
            )
        yield "</table>"
    if body := operation.get("requestBody"):
        yield f"<h4>Body</h4><p>{html.escape(body.get('description', ''))}</p><table>"
        yield from _contents(body["content"])
        yield "</table>"
    yield "<h4>Answers</h4><table>"
    for status, answer in sorted(operation["responses"].items()):
        kinds = ", ".join(_content(*item) for item in answer.get("content", {}).items())
        yield (
            f"<tr><td class=name><code>{html.escape(status)}</code>"
            f"<td>{html.escape(answer['description'])}<td class=type>{kinds}</tr>"
        )
    yield "</table></div></details>"


def _schema(name: str, schema: dict[str, Any]) -> Iterator[str]:
    yield (
        f'<details class=call id="schema-{html.escape(name)}"><summary><code>{html.escape(name)}'
        f"</code><span class=what>{html.escape(schema.get('description', ''))}</span></summary>"
        "<div>"
    )
    if properties := schema.get("properties"):
        yield "<table><tr><th>Name<th>Type<th>Meaning</tr>"
        required = schema.get("required", [])
        for key, value in properties.items():
            yield _row(key, None, value, value.get("description", ""), key in required)
        yield "</table>"
    else:
        yield f"<p>{describe_type(schema)}</p>"
    yield "</div></details>"


def _row(
    name: str, place: str | None, schema: dict[str, Any], words: str, is_required: bool
) -> str:
    mark = " <span class=required>required</span>" if is_required and place else ""
    where = "" if place is None else f"<td>{html.escape(place)}"
    return (
        f"<tr><td class=name><code>{html.escape(name)}</code>{mark}{where}"
        f"<td class=type>{describe_type(schema)}{describe_default(schema)}"
        f"<td>{html.escape(words)}</tr>"
    )


def _contents(content: dict[str, Any]) -> Iterator[str]:
    for media_type, item in content.items():
        yield (
            f"<tr><td class=name><code>{html.escape(media_type)}</code>"
            f"<td>{describe_type(item.get('schema', {}))}</tr>"
        )


def _content(media_type: str, item: dict[str, Any]) -> str:
    schema = item.get("schema", {})
    kind = f": {describe_type(schema)}" if "$ref" in schema else ""
    return f"<code>{html.escape(media_type)}</code>{kind}"


def _curl(path: str, method: str, operation: dict[str, Any], base: str) -> str:
    words = ["curl"]
    if method not in ("get", "post"):
        words.append(f"-X {method.upper()}")
    content = operation.get("requestBody", {}).get("content", {})
    if "application/octet-stream" in content:
        words.append("--data-binary @FILE")
    elif "application/json" in content:
        words.append(_EXAMPLE["application/json"])
    elif method == "post":
        words.append("-X POST")
    if "x-scope" in operation:
        words.append('-H "Authorization: Bearer $KEY"')
    required = [
        f"{parameter['name']}=…"
        for parameter in operation.get("parameters", ())
        if parameter["in"] == "query" and parameter.get("required")
    ]
    address = base + re.sub(r"\{(\w+)\}", lambda match: f"${match[1].upper()}", path)
    if required:
        address += f"?{'&'.join(required)}"
    return " ".join([*words, f'"{address}"'])


def _anchor(method: str, path: str) -> str:
    return f"{method}{_slug(path)}"


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).rstrip("-")
