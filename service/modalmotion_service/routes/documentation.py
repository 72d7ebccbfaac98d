"""The documentation page, made from the OpenAPI document; it loads nothing from elsewhere."""

from __future__ import annotations

import asyncio

from fastapi import Request
from starlette.responses import HTMLResponse

from modalmotion_service.contract.documentation.page import render
from modalmotion_service.contract.documentation.style import CSS
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.security_headers import policy_with_style

router = JudgedRouter(tags=["operation"])


@router.get("/docs", response_class=HTMLResponse, include_in_schema=False)
async def documentation(request: Request) -> HTMLResponse:
    """Describe every call on one page."""
    text = await asyncio.to_thread(render, request.app.openapi(), str(request.base_url).rstrip("/"))
    return HTMLResponse(text, headers={"Content-Security-Policy": policy_with_style(CSS)})
