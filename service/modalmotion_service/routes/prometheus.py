"""Metrics for Prometheus."""

from __future__ import annotations

import asyncio
from typing import Final

from fastapi import Request, Response
from prometheus_client.exposition import generate_latest

from modalmotion_service.http.judged_router import JudgedRouter

router = JudgedRouter(tags=["operation"])

_TEXT: Final = "text/plain; version=0.0.4; charset=utf-8"


@router.get(
    "/metrics",
    response_class=Response,
    responses={
        200: {
            "description": "Counts and gauges, as Prometheus reads them.",
            "content": {"text/plain": {"schema": {"type": "string"}}},
        }
    },
)
async def metrics(request: Request) -> Response:
    """Give metrics of requests, work, jobs and stores, over all owners together."""
    text = await asyncio.to_thread(generate_latest, request.app.state.metrics.registry)
    return Response(text, headers={"Content-Type": _TEXT})
