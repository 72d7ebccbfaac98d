"""Whether the service is alive and ready."""

from __future__ import annotations

from importlib.metadata import version

from fastapi import APIRouter, Request

from modalmotion.errors import StoreError
from modalmotion_service.disk import require_room
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
    local.analysis.engine.require_ready()
    try:
        require_room(local.store.root)
    except StoreError as error:
        # 503, whatever it is that is missing.
        raise StoreError(error.message, remedy=error.remedy) from error
    local.store.list_sequences(limit=1)
    return Health(version=version("modalmotion"))
