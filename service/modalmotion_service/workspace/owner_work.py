"""Work of one owner: tasks for workers, and files that they write."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from modalmotion.progress import StageReport
from modalmotion.signature.making import SignatureParameters
from modalmotion.store import ResultStore
from modalmotion_service.work.engine import Engine
from modalmotion_service.work.owner import work_of
from modalmotion_service.work.tariff import Tariff
from modalmotion_service.work.task_progress import followed
from modalmotion_service.workspace.quota import Quota
from modalmotion_service.workspace.shared_work import SharedWork
from modalmotion_service.workspace.spool import Spool, remove_with_beside

P = ParamSpec("P")
T = TypeVar("T")


class OwnerWork:
    """Has workers do tasks of one owner, each within its tariff.

    Parameters
    ----------
    store : ResultStore
    engine : Engine
        Where parsing and fitting happen.
    spool : Spool
        Where workers leave their output.
    tariff : Tariff
        Of the owner whose store it is.
    quota : Quota
        Of the same.
    """

    def __init__(
        self, store: ResultStore, engine: Engine, spool: Spool, tariff: Tariff, quota: Quota
    ) -> None:
        self._store = store
        self.engine = engine
        self._spool = spool
        self._tariff = tariff
        self.quota = quota
        self._shared_work = SharedWork()

    def within_store(self, path: Path) -> str:
        """Path of a result within the data folder."""
        return path.relative_to(self._store.root).as_posix()

    async def work(self, task: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Have a worker do a task."""
        terms = self._tariff.terms(task, args)
        # Cancelling the wait cancels the future, and with it ends the worker's process.
        with work_of(str(self._store.root)):
            future = self.engine.submit_for(terms, task, *args, **kwargs)
        return await asyncio.wrap_future(future)

    async def followed(self, report: StageReport, task: Callable[..., T], *args: Any) -> T:
        """Have a worker do a task whose last argument is a `ProgressFile`; report what it tells."""
        progress = self._spool.new_path()
        try:
            return await followed(self.work(task, *args, progress), progress, report)
        finally:
            remove_with_beside(progress)

    @contextmanager
    def image(self) -> Iterator[Path]:
        """Name a file for a worker to write and the store to take; it is removed in the end.

        Raises
        ------
        StoreError
            If the owner may store no more.
        """
        self.quota.require()
        with self.output() as path:
            try:
                yield path
            finally:
                path.unlink(missing_ok=True)

    @contextmanager
    def output(self) -> Iterator[Path]:
        """Name a file for a worker to write; it is removed if the work fails."""
        path = self._spool.new_path()
        try:
            yield path
        except BaseException:
            # Also removes a dead worker's leftovers.
            remove_with_beside(path)
            raise

    def template_path(self, parameters: SignatureParameters) -> Path | None:
        """File of the template that parameters name; None where they name none.

        Raises
        ------
        NotFoundError
            If there is no template of that id.
        """
        if parameters.template is None:
            return None
        return self._store.template_path(parameters.template)
