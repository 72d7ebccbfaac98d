"""Whether the service is alive and ready."""

from __future__ import annotations

from importlib.metadata import version

from fastapi import APIRouter

from modalmotion_service.dependencies import StateDependency
from modalmotion_service.schemas import Health

router = APIRouter(prefix="/health", tags=["health"])


@router.get("/live")
def live() -> Health:
    """Answer while the process runs."""
    return Health(version=version("modalmotion"))


@router.get("/ready")
def ready(state: StateDependency) -> Health:
    """Answer while results can be made and kept: the store answers, and there are workers."""
    state.analysis.engine.require_ready()
    state.store.list_sequences(limit=1)
    return Health(version=version("modalmotion"))
