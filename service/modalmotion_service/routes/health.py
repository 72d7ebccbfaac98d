"""Whether the service is alive and ready."""

from __future__ import annotations

from importlib.metadata import version

from fastapi import Request

from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.monitoring.metrics import require_ready
from modalmotion_service.schemas import Health, Readiness

router = JudgedRouter(prefix="/health", tags=["health"])


@router.get("/live")
def live() -> Health:
    """Answer while the process runs."""
    return Health(version=version("modalmotion"))


@router.get("/ready")
def ready(request: Request) -> Readiness:
    """Answer while results can be made and stored: the store answers, and there are workers."""
    local = request.app.state.owners.local
    require_ready(local)
    confined = local.analysis.engine.are_parsers_confined
    return Readiness(
        version=version("modalmotion"),
        stateless=local.settings.stateless,
        parsers_confined=confined,
    )
