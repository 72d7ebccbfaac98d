"""Whether the service is alive and ready."""

from __future__ import annotations

from importlib.metadata import version

from fastapi import APIRouter, Request

from modalmotion_service.errors import ClusterError
from modalmotion_service.schemas import Health

router = APIRouter(prefix="/health", tags=["health"])


@router.get("/live")
def live() -> Health:
    """Answer while the process runs."""
    return Health(version=version("modalmotion"))


@router.get("/ready")
def ready(request: Request) -> Health:
    """Answer while results can be made and kept: the store answers, and there are workers."""
    local = request.app.state.owners.local
    try:
        local.analysis.engine.require_ready()
    except ClusterError as error:
        # Everybody may ask: the error itself names a machine inside.
        raise ClusterError(
            "The machines that work is sent to cannot be used now.",
            remedy="Try again soon; the service's log says which they are.",
        ) from error
    local.store.list_sequences(limit=1)
    return Health(version=version("modalmotion"))
