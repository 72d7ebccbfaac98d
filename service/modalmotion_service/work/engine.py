"""Where work is done: in processes here, or on the workers of a scheduler."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from modalmotion.errors import needs_extra
from modalmotion.store.disk.atomic import make_folder
from modalmotion_service.settings import Settings
from modalmotion_service.work.dask.executor import DaskExecutor
from modalmotion_service.work.executor import Engine
from modalmotion_service.work.pool import WorkerPool


def open_engine(settings: Settings, folder: Path | None = None) -> Engine:
    """Start what the settings say.

    Parameters
    ----------
    settings : Settings
        With a `scheduler`, work is sent to its workers; else `workers` processes do it here,
        and one more what is short.
    folder : Path, optional
        Folder that a scheduler's workers must share, with a file in it that they are known by;
        `cluster` in the data folder by default.

    Raises
    ------
    ClusterError
        If there is no such scheduler, it has no workers, or one does not share the folder.
    """
    limits = (settings.task_seconds, settings.task_memory_bytes)
    if settings.scheduler is None:
        return WorkerPool(settings.workers, *limits, has_lane=True)
    with needs_extra("cluster"):
        if find_spec("distributed") is None:
            raise ModuleNotFoundError(name="distributed")
    shared = settings.data_dir.absolute() / "cluster" if folder is None else folder
    make_folder(shared)
    return DaskExecutor(
        settings.scheduler, shared, *limits, connect_seconds=settings.cluster_seconds
    )
