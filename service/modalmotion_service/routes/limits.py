"""Limits of the service."""

from __future__ import annotations

from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.routes.parts.dependencies import StateDependency

router = JudgedRouter(prefix="/v1", tags=["limits"])


@router.get("/limits")
def limits(state: StateDependency) -> dict[str, float]:
    """Give every limit, by the name that its error gives it."""
    return state.settings.limits
