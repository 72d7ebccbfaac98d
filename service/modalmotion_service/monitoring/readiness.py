"""Whether results can be made and stored."""

from __future__ import annotations

from modalmotion.errors import StoreError
from modalmotion_service.errors import ClusterError, NoWorkerError
from modalmotion_service.workspace.disk import require_room
from modalmotion_service.workspace.state import State


def require_ready(local: State) -> None:
    """Check that there are workers, that the disk has room, and that the store answers.

    Parameters
    ----------
    local : State
        Of the data folder itself.

    Raises
    ------
    ClusterError, StoreError
        If not; both are answered 503.
    """
    try:
        local.analysis.engine.require_ready()
    except NoWorkerError:
        raise
    except ClusterError as error:
        # Everybody may ask: the error itself names a machine inside.
        raise ClusterError(
            "The machines that work is sent to cannot be used now.",
            remedy="Try again soon; the service's log says which they are.",
        ) from error
    try:
        require_room(local.store.root)
    except StoreError as error:
        # Never 507: nobody has sent anything.
        raise StoreError(error.message, remedy=error.remedy) from error
    local.store.list_sequences(limit=1)
