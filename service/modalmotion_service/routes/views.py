"""Pages on which sequences can be looked at, and what they are sent."""

from __future__ import annotations

from typing import Annotated, Final

from fastapi import Header, Query, Request, Response
from starlette.exceptions import HTTPException
from starlette.responses import HTMLResponse

from modalmotion.viewer.bundle_files import NOTHING, content_name, script, style
from modalmotion_service.http.conditional import is_known, not_modified, tag_of
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import HTML, VIEW, best_type
from modalmotion_service.routes.parts.deferral import reply_or_job
from modalmotion_service.routes.parts.dependencies import PreferenceDependency, StateDependency
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, BINARY, PROBLEMS
from modalmotion_service.schemas import SequenceId, SignatureQuery
from modalmotion_service.schemas.request_queries import ViewFramesQuery

pages = JudgedRouter(include_in_schema=False)
router = JudgedRouter(prefix="/v1/sequences", tags=["views"], responses=PROBLEMS)

# The page asks this service only. It holds no data: these come with the key, which is typed in.
_POLICY: Final = (
    f"{NOTHING}; script-src 'self'; style-src 'self'; connect-src 'self'; frame-ancestors 'none'"
)
_WELCOME: Final = (
    '<header><p class="brand">modalmotion</p><h1>How a surface deforms over time</h1>'
    '<p class="lead">A beating ventricle, a tongue, any mesh sequence: a few amplitudes per frame, '
    "volumes and strain with intervals, the class of the motion, and a report.</p></header>"
)
_FOR_EVER: Final = "public, max-age=31536000, immutable"


@pages.get("/", response_class=HTMLResponse)
@pages.get("/view/{sequence_id}", response_class=HTMLResponse)
@pages.get("/images/{images_id}", response_class=HTMLResponse)
def page(request: Request) -> HTMLResponse:
    """Give the page that lists sequences, and shows what its address names."""
    head = (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        "<title>modalmotion</title>"
        f'<link rel="stylesheet" href="/viewer/{content_name(style())}.css">'
        f'<script type="module" src="/viewer/{content_name(script())}.js"></script></head>'
    )
    is_first = request.url.path.endswith("/")
    shown = f'<div class="home">{_WELCOME}</div>' if is_first else ""
    body = (
        f'<body><main id="modalmotion" class="modalmotion">{shown}</main>'
        f'<template id="welcome">{_WELCOME}</template></body></html>'
    )
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


@router.get(
    "/{sequence_id}/view",
    response_class=Response,
    responses={
        200: {"description": "What the page reads.", "content": {VIEW: BINARY, HTML: BINARY}},
        **ACCEPTED,
    },
)
async def view(
    sequence_id: SequenceId,
    query: Annotated[SignatureQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
    accept: Annotated[str, Header(description=f"{VIEW}, or {HTML} for one file.")] = VIEW,
) -> Response:
    """Give what `/view/{sequence_id}` shows: for that page, or as a page of one file.

    The file opens from disk, without a network. In the other form are the reference, its natural
    coordinates, the amplitudes, volume and segments, but no frames as sent.
    """
    media_type = best_type(accept, (VIEW, HTML))
    parameters, _facts = state.analysis.resolved(sequence_id, query.parameters())
    record = state.store.sequence_record(sequence_id)
    tag = tag_of(sequence_id, parameters.key, "view", media_type, repr(record.facts), script())
    if is_known(request, tag):
        return not_modified(tag)
    body = {"sequence_id": sequence_id, "query": query, "media_type": media_type}
    headers = {"ETag": tag, "Vary": "Accept"}
    return await reply_or_job(state, preference, "view", body, headers=headers)


@router.get(
    "/{sequence_id}/view/frames",
    response_class=Response,
    responses={
        200: {"description": "What the page reads.", "content": {VIEW: BINARY}},
        **ACCEPTED,
    },
)
async def view_frames(
    sequence_id: SequenceId,
    query: Annotated[ViewFramesQuery, Query()],
    state: StateDependency,
    preference: PreferenceDependency,
) -> Response:
    """Give frames as they were sent, in 65,536 steps of their box, for `/view/{sequence_id}`."""
    state.store.sequence_record(sequence_id)
    body = {"sequence_id": sequence_id, "query": query}
    return await reply_or_job(state, preference, "view-frames", body)
