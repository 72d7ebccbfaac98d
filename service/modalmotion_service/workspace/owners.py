"""The owners' stores: each in a folder of its own, so that nobody meets another's data.

Idempotency keys, jobs, results, caches and files under way all belong to a store. For an owner
only their own data exists; nothing shows what others have.
"""

import asyncio
import logging
import shutil
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Final

from modalmotion.errors import ModalMotionError, StoreError
from modalmotion.store import ResultStore, backup_time
from modalmotion_service.access.scopes import LOCAL, require_owner
from modalmotion_service.settings import Settings
from modalmotion_service.work.engine import Engine
from modalmotion_service.work.tariff import Tariff
from modalmotion_service.workspace import (
    file_operations,
    model_operations,
    recording_operations,
    signature_operations,
)
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.job_runner import Retention, for_ever, sweep_for_ever
from modalmotion_service.workspace.jobs import IdempotencyKeys, Jobs
from modalmotion_service.workspace.operation import Operation, Performance, State
from modalmotion_service.workspace.spool import Quota, Spool

_SERVED: Final = ("models", "templates")


def lay_out(source: Path, root: Path) -> None:
    """Have the models and templates of a store in another one, which is new, by links to files.

    Parameters
    ----------
    source : Path
        Folder of an owner's store, or of its backup; may be missing.
    root : Path

    Raises
    ------
    StoreError
        If the folder cannot be read.
    """
    try:
        for name in _SERVED:
            for file in (source / name).rglob("*") if (source / name).is_dir() else ():
                if not file.is_file():
                    continue
                link = root / file.relative_to(source)
                link.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
                if not link.is_symlink():
                    link.symlink_to(file.absolute())
    except OSError as error:
        raise StoreError(
            f"Models and templates of '{source.name}' cannot be read: {error.strerror}.",
            remedy="Check the folder that is named as --read-only-dir.",
        ) from error


_MODULES: Final = (
    *(recording_operations, signature_operations, file_operations, model_operations),
)

OPERATIONS: Final[dict[str, Operation]] = {
    one.name: one
    for module in _MODULES
    for one in vars(module).values()
    if isinstance(one, Operation)
}
"""All operations, by name."""


logger = logging.getLogger(__name__)

FOLDER: Final = "owners"

# Between two looks after stores that could not be opened and jobs that nobody does.
_LOOK_SECONDS: Final = 30.0


def folder_of(data_dir: Path, owner: str) -> Path:
    """Folder that an owner's store is in.

    Raises
    ------
    ParameterError
        If the name is not valid.
    """
    require_owner(owner)
    return data_dir if owner == LOCAL else data_dir / FOLDER / owner


def trainings_at_once(settings: Settings) -> int:
    """Give how many models train at a time; each may take all of a processor for long."""
    return max(1, settings.workers // 2)


class Owners:
    """Open state of each owner; all share the worker processes.

    Parameters
    ----------
    settings : Settings
    engine : Engine
        For requests.
    training_engine : Engine
    """

    def __init__(self, settings: Settings, engine: Engine, training_engine: Engine) -> None:
        self._settings = settings
        self._engine = engine
        self._training_engine = training_engine
        self._states: dict[str, State] = {}
        self._failed: set[str] = set()
        self._opening = asyncio.Lock()
        self._background: list[asyncio.Task[None]] = []

    @property
    def states(self) -> dict[str, State]:
        """Open states, by owner."""
        return dict(self._states)

    @property
    def n_failed(self) -> int:
        """Owners whose store could not be opened, and has not been since."""
        return len(self._failed)

    @property
    def local(self) -> State:
        """State of the store in the data folder itself."""
        return self._states[LOCAL]

    def free_bytes(self) -> int:
        """Free space on the disk that the stores are on."""
        return shutil.disk_usage(self._settings.data_dir).free

    async def open(self) -> None:
        """Open every store, and take up unfinished jobs.

        Raises
        ------
        StoreError
            If the data folder itself cannot be used, as when another service has it.
        """
        await self.state(LOCAL)
        if (time := backup_time(self._settings.data_dir)) is not None:
            logger.warning(
                "the data folder is a backup: what was deleted since is in it again",
                extra={"as_of": time},
            )
        folder = self._settings.data_dir / FOLDER
        for path in sorted(folder.iterdir()) if folder.is_dir() else ():
            # Remains of an owner whose removal was interrupted.
            if not path.name.startswith("."):
                await self._try_to_open(path.name)
        looking = for_ever("owners", self._look_after, _LOOK_SECONDS)
        self._background.append(asyncio.create_task(looking))

    async def _try_to_open(self, owner: str) -> None:
        try:
            await self.state(owner)
        except ModalMotionError as error:
            self._failed.add(owner)
            # One damaged store closes no other; its owner gets the error on request.
            logger.error(  # noqa: TRY400 (the error says what is wrong, and its traceback no more)
                "a store cannot be opened", extra={"owner": owner, "code": error.code}
            )

    async def _look_after(self) -> None:
        """Open what could not be opened, and take up jobs that have been lost track of."""
        for owner in sorted(self._failed):
            # Its jobs were acknowledged, and wait for it.
            if folder_of(self._settings.data_dir, owner).is_dir():
                await self._try_to_open(owner)
        for state in list(self._states.values()):
            await state.runner.resume()
            await asyncio.to_thread(state.idempotency.write_late)

    async def state(self, owner: str) -> State:
        """Give the state of an owner, opened when it is first needed."""
        state = self._states.get(owner)
        if state is None:
            async with self._opening:
                state = self._states.get(owner)
                if state is None:
                    state = await self._open(owner)
        return state

    async def close(self) -> None:
        """Let jobs finish for a while, then close every store."""
        for task in self._background:
            task.cancel()
        drain = self._settings.drain_seconds
        await asyncio.gather(*(state.runner.close(drain) for state in self._states.values()))
        for owner, state in self._states.items():
            try:
                await asyncio.to_thread(state.store.close)
            except ModalMotionError as error:
                # The next start looks at its files; the others are closed properly.
                logger.error(  # noqa: TRY400 (the error says what is wrong, and its traceback no more)
                    "a store cannot be closed", extra={"owner": owner, "code": error.code}
                )
        self._states.clear()

    async def _open(self, owner: str) -> State:
        settings, root = self._settings, folder_of(self._settings.data_dir, owner)
        if settings.stateless and settings.read_only_dir is not None:
            source = folder_of(settings.read_only_dir, owner)
            await asyncio.to_thread(lay_out, source, root)
        store = ResultStore(root, keep_uploads=settings.keep_uploads)
        await asyncio.to_thread(store.open)
        try:
            jobs, keys = Jobs(store.database), IdempotencyKeys(store.database)
            keys.release_unfinished()
            spool = Spool(root / "spool", settings.reserve_bytes)
            retention = Retention(
                *(jobs, keys, spool, root),
                file_age=timedelta(hours=settings.result_hours),
                job_age=timedelta(days=settings.job_days),
            )
            spool.clear(keep=await asyncio.to_thread(retention.needed))
            tariff = Tariff(str(root), settings.task_cost_factor, settings.task_cost_seconds)
            quota = Quota(root, settings.max_owner_bytes)
            analysis = Analysis(store, self._engine, spool, tariff, quota)
            n_workers, n_apart = self._engine.n_workers, trainings_at_once(settings)
            runner = Performance(OPERATIONS, settings, jobs, n_workers, n_apart)
            training = self._training_engine
            state = State(settings, store, spool, analysis, training, jobs, keys, runner)
            runner.state = state
            await runner.resume()
        except BaseException:
            await asyncio.to_thread(store.close)
            raise
        self._states[owner] = state
        self._failed.discard(owner)
        age = timedelta(hours=settings.image_hours)
        for work in (
            sweep_for_ever("sweep", retention.sweep, retention.file_age),
            sweep_for_ever("images", partial(recording_operations.sweep_images, state, age), age),
            quota.measure_for_ever(),
        ):
            self._background.append(asyncio.create_task(work))
        return state
