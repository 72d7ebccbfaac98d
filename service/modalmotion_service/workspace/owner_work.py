"""Work of one owner: tasks for workers, files that they write, and work that many wait for."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from modalmotion.errors import (
    ModalMotionError,
    ModeCountError,
    TopologyError,
    UnlikeCasesError,
)
from modalmotion.modes.topology import MESH
from modalmotion.progress import StageReport
from modalmotion.signature.making import SignatureParameters
from modalmotion.store import ResultStore
from modalmotion_service.http.observation import add_milliseconds, stage
from modalmotion_service.work.engine import Engine
from modalmotion_service.work.tariff import Tariff
from modalmotion_service.work.task_progress import followed
from modalmotion_service.workspace.spool import Quota, Spool, remove_with_beside

T = TypeVar("T")
A = TypeVar("A")


def unheard(_share: float, _text: str = "") -> None:
    """Report progress to nobody."""


class SharedWork:
    """Work under way, by what it makes.

    A request for a result that is being made waits for it. Work whose last waiter has gone
    is cancelled.
    """

    def __init__(self) -> None:
        self._tasks: dict[Hashable, asyncio.Task[Any]] = {}
        self._waiters: dict[Hashable, list[StageReport]] = {}

    async def join(
        self,
        key: Hashable,
        make: Callable[[StageReport], Awaitable[T]],
        report: StageReport = unheard,
    ) -> T:
        """Wait for the work of that key, begun now if nobody has.

        Parameters
        ----------
        key : hashable
        make : async function
            Does the work; called with a function that tells all who wait how far it is.
        report : callable
            Called with the share that is done, and with what is done now.
        """
        task: asyncio.Task[T] | None = self._tasks.get(key)

        def tell(share: float, text: str = "") -> None:
            for waiter in self._waiters.get(key, ()):
                waiter(share, text)

        if task is None:
            task = asyncio.ensure_future(make(tell))
            self._tasks[key] = task
            # From then on the result is in the store: the next request finds it there.
            task.add_done_callback(lambda _: self._tasks.pop(key, None))
        waiters = self._waiters.setdefault(key, [])
        waiters.append(report)
        try:
            # The shield lets one waiter go without taking the work from the others.
            return await asyncio.shield(task)
        except asyncio.CancelledError:
            if len(waiters) == 1 and not task.done():
                task.cancel()
                await asyncio.wait([task])
            raise
        finally:
            waiters.remove(report)
            if not waiters and self._waiters.get(key) is waiters:
                del self._waiters[key]


P = ParamSpec("P")


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
        self.shared_work = SharedWork()

    async def work(self, task: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Have a worker do a task."""
        terms = self._tariff.terms(task, args)
        # Cancelling the wait cancels the future, and with it ends the worker's process.
        return await asyncio.wrap_future(self.engine.run(terms, task, *args, **kwargs))

    async def followed(self, report: StageReport, task: Callable[..., T], *args: Any) -> T:
        """Have a worker do a task whose last argument is a `ProgressFile`; report what it tells."""
        progress = self._spool.new_path()
        try:
            return await followed(self.work(task, *args, progress), progress, report)
        finally:
            remove_with_beside(progress)

    async def staged(
        self, report: StageReport, task: Callable[..., tuple[Any, ...]], *args: Any
    ) -> list[Any]:
        """Have a worker do a task as `followed` does; the last it gives are milliseconds by stage.

        They are those of the request; the rest is given.
        """
        with stage("worker"):
            *found, milliseconds = await self.followed(report, task, *args)
            add_milliseconds(milliseconds)
        return found

    async def each(
        self,
        items: Sequence[A],
        work: Callable[[A], Awaitable[T]],
        told: Callable[[int, int], None],
    ) -> list[T]:
        """Do something for each of many, as many at a time as there are workers.

        Parameters
        ----------
        items : sequence
        work : async function
            What fails with an error of ours lets none begin after it; those under way are finished.
        told : callable
            Called with the number that is done, and that of all.
        """
        done: dict[int, T] = {}
        failures: list[ModalMotionError] = []
        waiting = iter(enumerate(items))

        async def take() -> None:
            for number, item in waiting:
                try:
                    done[number] = await work(item)
                except ModalMotionError as error:
                    failures.append(error)
                if failures:
                    return
                told(len(done), len(items))

        takers = [asyncio.ensure_future(take()) for _ in range(self.engine.n_workers)]
        try:
            await asyncio.gather(*takers)
        finally:
            for taker in takers:
                taker.cancel()
            await asyncio.wait(takers)
        if failures:
            raise failures[0]
        return [done[number] for number in range(len(items))]

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


async def in_one_basis(
    make: Callable[[SignatureParameters], Awaitable[T]], parameters: SignatureParameters
) -> T:
    """Make something of several signatures, all with spring modes where their own do not compare.

    As the library does it where the sequences are at hand.
    """
    try:
        return await make(parameters)
    except UnlikeCasesError as unlike:
        if parameters.topology is not None:
            raise
        try:
            return await make(replace(parameters, topology=MESH))
        except (UnlikeCasesError, TopologyError, ModeCountError):
            raise unlike from None
