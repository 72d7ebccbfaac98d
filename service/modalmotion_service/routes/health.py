"""Whether the service is alive and ready."""

from __future__ import annotations

from importlib.metadata import version

from fastapi import APIRouter, Request

from modalmotion_service.monitoring.readiness import require_ready
from modalmotion_service.schemas import Health

router = APIRouter(prefix="/health", tags=["health"])


@router.get("/live")
def live() -> Health:
    """Answer while the process runs."""
    return Health(version=version("modalmotion"))


@router.get("/ready")
def ready(request: Request) -> Health:
    """Answer while results can be made and stored: the store answers, and there are workers."""
    require_ready(request.app.state.owners.local)
    return Health(version=version("modalmotion"))
