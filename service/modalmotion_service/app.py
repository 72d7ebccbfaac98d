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
from modalmotion_service.body_limit import BodyLimit
from modalmotion_service.routes import classifications, health, sequences, signatures
from modalmotion_service.settings import Settings


def create_app(settings: Settings | None = None) -> FastAPI:
    """Make the application; nothing is read or opened before its lifespan starts.

    Parameters
    ----------
    settings : Settings, optional
        Read from the environment by default.
    """
    chosen = Settings() if settings is None else settings

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        with ResultStore(chosen.data_dir, keep_uploads=chosen.keep_uploads) as store:
            app.state.settings = chosen
            app.state.store = store
            app.state.analysis = Analysis(store)
            yield

    app = FastAPI(
        title="modalmotion",
        version=version("modalmotion"),
        summary="Modal signatures and motion classes of nonrigidly moving surfaces.",
        description=INTENDED_USE,
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
        lifespan=lifespan,
    )
    problems.install(app)
    app.add_middleware(BodyLimit, max_body_bytes=chosen.max_body_bytes)
    for module in (sequences, signatures, classifications, health):
        app.include_router(module.router)
    return app
