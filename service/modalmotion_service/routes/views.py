"""Pages on which sequences can be looked at."""

from __future__ import annotations

from typing import Final

from fastapi import Response
from starlette.exceptions import HTTPException
from starlette.responses import HTMLResponse

from modalmotion.viewer.bundle_files import NOTHING, content_name, script, style
from modalmotion_service.http.judged_router import JudgedRouter

pages = JudgedRouter(include_in_schema=False)

# The page asks this service only. It holds no data: these come with the key, which is typed in.
_POLICY: Final = (
    f"{NOTHING}; script-src 'self'; style-src 'self'; connect-src 'self'; frame-ancestors 'none'"
)
_FOR_EVER: Final = "public, max-age=31536000, immutable"


@pages.get("/", response_class=HTMLResponse)
@pages.get("/view/{key}", response_class=HTMLResponse)
@pages.get("/images/{images_id}", response_class=HTMLResponse)
def page() -> HTMLResponse:
    """Give the page that lists sequences, and shows what its address names."""
    head = (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        "<title>modalmotion</title>"
        f'<link rel="stylesheet" href="/viewer/{content_name(style())}.css">'
        f'<script type="module" src="/viewer/{content_name(script())}.js"></script></head>'
    )
    body = '<body><main id="modalmotion" class="modalmotion"></main></body></html>'
    return HTMLResponse(head + body, headers={"Content-Security-Policy": _POLICY})


@pages.get("/viewer/{name}")
def bundle(name: str) -> Response:
    """Give the script or the style sheet, which its content names."""
    if name == f"{content_name(script())}.js":
        text, kind = script(), "text/javascript"
    elif name == f"{content_name(style())}.css":
        text, kind = style(), "text/css"
    else:
        raise HTTPException(404, "There is no such file of the viewer.")
    return Response(text, media_type=kind, headers={"Cache-Control": _FOR_EVER})
