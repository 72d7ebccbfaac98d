"""Pages on which sequences can be looked at, and the interface is described."""

import json
from typing import Final

from fastapi import Request, Response
from starlette.exceptions import HTTPException
from starlette.responses import HTMLResponse

from modalmotion.viewer.page import AFTER_PAINT, NOTHING, content_name, script, source_hash, style
from modalmotion_service.http.gated_router import GatedRouter
from modalmotion_service.http.middleware import PREFIX

pages = GatedRouter(include_in_schema=False)

# The page asks this service only. It holds no data: these come with the key, which is typed in.
_POLICY: Final = f"{NOTHING}; connect-src 'self'; frame-ancestors 'none'"
# Swagger UI as it is published: its digests say that nothing else runs.
_SWAGGER: Final = "https://cdn.jsdelivr.net/npm/swagger-ui-dist@5.35.0"
_SWAGGER_SCRIPT: Final = "sha384-gjRm0bEPMeTmMh5jT2cHccIwCUZSTd8YC+j0d0sXw0MdGEfScduGpSyF3ZSSLkX9"
_SWAGGER_STYLE: Final = "sha384-WlYgdmXYOOBWL5apwjDEZwN+U3HmXSSu5R6V5aGxEcf7z+KuRNwBhoxKVN1i3D5I"
_SHOW: Final = "SwaggerUIBundle({url: 'openapi.json', dom_id: '#docs', deepLinking: true})"
_DOCS_POLICY: Final = (
    f"{NOTHING}; script-src {_SWAGGER}/ {source_hash(_SHOW)}; frame-ancestors 'none'; "
    f"style-src {_SWAGGER}/ 'unsafe-inline'; img-src data:; connect-src 'self'"
)
_WELCOME: Final = (
    '<header><p class="brand">modalmotion</p><h1>How a surface deforms over time</h1>'
    '<p class="lead">A beating ventricle, a tongue, any mesh sequence: a few amplitudes per frame, '
    "volumes and strain with intervals, the class of the motion, and a report.</p></header>"
)
_FOR_EVER: Final = "public, max-age=31536000, immutable"


@pages.get("/", response_class=HTMLResponse)
@pages.get("/view/{key}", response_class=HTMLResponse)
@pages.get("/images/{images_id}", response_class=HTMLResponse)
def page(request: Request) -> HTMLResponse:
    """Give the page that lists sequences, and shows what its address names."""
    address = f"{request.scope.get(PREFIX, '')}/viewer/{content_name(script())}.js"
    start = f"const start = () => import({json.dumps(address)}); "
    is_first = request.url.path.endswith("/")
    # What the first page says is on the screen before the script takes the processor.
    start += AFTER_PAINT if is_first else "start();"
    head = (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>modalmotion</title><style>{style()}</style></head>"
    )
    shown = f'<div class="home">{_WELCOME}</div>' if is_first else ""
    body = (
        f'<body><main id="modalmotion" class="modalmotion">{shown}</main>'
        f'<template id="welcome">{_WELCOME}</template>'
        f"<script>{start}</script></body></html>"
    )
    sources = f"script-src 'self' {source_hash(start)}; style-src {source_hash(style())}"
    return HTMLResponse(head + body, headers={"Content-Security-Policy": f"{_POLICY}; {sources}"})


@pages.get("/viewer/{name}")
def bundle(name: str) -> Response:
    """Give the script, which its content names."""
    if name != f"{content_name(script())}.js":
        raise HTTPException(404, "There is no such file of the viewer.")
    headers = {"Cache-Control": _FOR_EVER}
    return Response(script(), media_type="text/javascript", headers=headers)


@pages.get("/docs", response_class=HTMLResponse)
def docs() -> HTMLResponse:
    """Give a page that shows openapi.json and tries its calls; it loads Swagger UI."""
    given = 'crossorigin="anonymous" integrity='
    return HTMLResponse(
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>modalmotion</title>'
        f'<link rel="stylesheet" href="{_SWAGGER}/swagger-ui.css" {given}"{_SWAGGER_STYLE}">'
        '</head><body><div id="docs"><a href="openapi.json">openapi.json</a></div>'
        f'<script src="{_SWAGGER}/swagger-ui-bundle.js" {given}"{_SWAGGER_SCRIPT}"></script>'
        f"<script>{_SHOW}</script></body></html>",
        headers={"Content-Security-Policy": _DOCS_POLICY},
    )
