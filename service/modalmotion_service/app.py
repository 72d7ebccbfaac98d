"""The application."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.metadata import version

from fastapi import FastAPI

from modalmotion.signature import INTENDED_USE
from modalmotion.store import ResultStore
from modalmotion_service import problems
from modalmotion_service.analysis import Analysis
from modalmotion_service.dependencies import State
from modalmotion_service.executor import WorkerPool
from modalmotion_service.incoming import BodyLimits, Concurrency
from modalmotion_service.job_kinds import make_runner
from modalmotion_service.observation import Observation
from modalmotion_service.routes import (
    classifications,
    codec,
    health,
    jobs,
    limits,
    sequences,
    signatures,
    templates,
    tradeoff,
)
from modalmotion_service.settings import Settings
from modalmotion_service.spool import Spool


def create_app(settings: Settings | None = None) -> FastAPI:
    """Make the application; nothing is opened before its lifespan starts.

    Parameters
    ----------
    settings : Settings, optional
        Read from the environment by default.
    """
    chosen = Settings() if settings is None else settings

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        with ResultStore(chosen.data_dir, keep_uploads=chosen.keep_uploads) as store:
            executor = WorkerPool(chosen.workers, chosen.task_seconds, chosen.task_memory_bytes)
            try:
                spool = Spool(chosen.data_dir / "spool")
                analysis = Analysis(store, executor, spool)
                runner = make_runner(chosen, store, spool, analysis)
                app.state.service = State(chosen, store, spool, analysis, runner)
                store.idempotency.release_unfinished()
                await runner.resume()
                yield
                await runner.close(chosen.drain_seconds)
            finally:
                executor.shutdown(cancel_futures=True)

    app = FastAPI(
        title="modalmotion",
        version=version("modalmotion"),
        summary="Modal signatures and motion classes of nonrigidly moving surfaces.",
        description=INTENDED_USE,
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
        lifespan=lifespan,
    )
    problems.install(app)
    # The last one added is the outermost.
    app.add_middleware(
        BodyLimits,
        body_bytes=chosen.max_body_bytes,
        idle_seconds=chosen.idle_seconds,
        upload_seconds=chosen.upload_seconds,
    )
    app.add_middleware(Concurrency, most=chosen.max_concurrent_requests)
    app.add_middleware(Observation)
    for module in (
        sequences,
        signatures,
        tradeoff,
        templates,
        codec,
        classifications,
        jobs,
        limits,
        health,
    ):
        app.include_router(module.router)
    return app
