"""The application, with a store or without one."""

import asyncio
import shutil
from collections.abc import AsyncIterator, Iterable, Iterator
from contextlib import asynccontextmanager, contextmanager
from functools import partial
from typing import Any, Final, NoReturn

from fastapi import Depends, FastAPI
from fastapi.middleware.cors import CORSMiddleware
from fastapi.routing import APIRoute

from modalmotion.hdf5.image import INTENDED_USE
from modalmotion_service import document, errors
from modalmotion_service.access.audit import AuditLog, Lines
from modalmotion_service.access.keys import KeyRing, KeySnapshot
from modalmotion_service.access.logins import logins_of
from modalmotion_service.access.rates import Rates
from modalmotion_service.http import middleware, problems
from modalmotion_service.http.gate import Access, Gate, require_gate
from modalmotion_service.http.gated_router import BODIES
from modalmotion_service.monitoring.metrics import Metrics, StateOfThings
from modalmotion_service.monitoring.observation import Observation, Telemetry
from modalmotion_service.routes import (
    models,
    operation,
    recordings,
    sequences,
    signatures,
    uploads,
    views,
)
from modalmotion_service.routes.asked import EXAMPLES
from modalmotion_service.schemas.general import Problem
from modalmotion_service.settings import Settings
from modalmotion_service.work import pool, upload
from modalmotion_service.workspace.job_runner import for_ever
from modalmotion_service.workspace.owners import Owners, trainings_at_once


class _App(FastAPI):
    def openapi(self) -> dict[str, Any]:
        if self.openapi_schema is None:
            self.openapi_schema = document.completed(super().openapi(), BODIES, Problem, EXAMPLES)
        return self.openapi_schema


@contextmanager
def _access(settings: Settings) -> Iterator[Access]:
    """Open keys and audit log; where nothing is kept, keys that are only read and lines."""
    target = settings.audit_stream or ("stdout" if settings.stateless else None)
    lines = None if target is None else Lines(target, settings.audit_form)
    kept, read = settings.data_dir, settings.read_only_dir
    keys = KeySnapshot(read) if settings.stateless else KeyRing(kept)
    with keys, AuditLog(None if settings.stateless else kept, lines) as log:
        yield Access(keys, log)


async def _forget(log: AuditLog, settings: Settings) -> None:
    """Remove old entries of the audit log every hour, where an operator says how old."""
    if (days := settings.audit_days) and not settings.stateless:
        await for_ever("audit", partial(asyncio.to_thread, log.forget_before, days), 3600.0)


def gated_routes() -> list[APIRoute]:
    """Give all routes, made once for all applications of a process."""
    routers = [
        *(sequences.router, signatures.router, uploads.router, recordings.router),
        *(sequences.of_templates, models.router, models.of_norms),
        *(operation.of_jobs, operation.router, views.pages),
    ]
    routes = (route for router in routers for route in router.routes)
    return [route for route in routes if isinstance(route, APIRoute)]


def create_app(settings: Settings | None = None, telemetry: Telemetry | None = None) -> FastAPI:
    """Make the application; nothing is opened before its lifespan starts.

    Parameters
    ----------
    settings : Settings, optional
        Read from the environment by default.
    telemetry : Telemetry, optional
        As the settings say by default.
    """
    chosen = Settings() if settings is None else settings
    # Absolute, for tasks carry paths to workers that were started elsewhere.
    chosen = chosen.model_copy(update={"data_dir": chosen.data_dir.absolute()})
    metrics = Metrics()
    if telemetry is None and chosen.telemetry:
        telemetry = Telemetry()

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        engine = await asyncio.to_thread(pool.open_engine, chosen)
        if engine.are_parsers_confined is not None:
            upload.say_whether_confined()
        # Processes of its own, on this machine: no request waits for a training.
        training_pool = pool.WorkerPool(
            trainings_at_once(chosen),
            chosen.training_seconds,
            chosen.task_memory_bytes,
            seconds_limit="training_seconds",
        )
        watchers = (metrics.watch, *(() if telemetry is None else (telemetry.task,)))
        engine.watchers = training_pool.watchers = watchers
        owners = Owners(chosen, engine, training_pool)
        things = StateOfThings(owners, metrics, engine)
        metrics.registry.register(things)
        try:
            await owners.open()
            with _access(chosen) as access:
                app.state.owners, app.state.access = owners, access
                app.state.metrics = metrics
                forgetting = asyncio.create_task(_forget(access.audit, chosen))
                yield
                forgetting.cancel()
                await access.audit.drain()
        finally:
            metrics.registry.unregister(things)
            await owners.close()
            training_pool.shutdown(cancel_futures=True)
            engine.shutdown(cancel_futures=True)
            if telemetry is not None:
                telemetry.close()
            if chosen.stateless:
                # Here, for a signal ends the process without what Python does at its end.
                await asyncio.to_thread(shutil.rmtree, chosen.data_dir, ignore_errors=True)

    app = _App(
        title="modalmotion",
        version=middleware.API_VERSION,
        docs_url=None,
        redoc_url=None,
        # One address for one thing; a redirect would repeat any host that the client names.
        redirect_slashes=False,
        # The framework's own tells paths, queries and texts of errors to whoever collects.
        telemetry={"tracing": False, "metrics": False, "logs": False},
        summary="Modal signatures and motion classes of nonrigidly moving surfaces.",
        description=INTENDED_USE,
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
        servers=[{"url": chosen.path_prefix}] if chosen.path_prefix else None,
        # Of routes that are added to this one.
        dependencies=[Depends(require_gate)],
        lifespan=lifespan,
    )
    problems.install(app)
    # The last one added is the outermost.
    app.add_middleware(middleware.HeadAsGet)
    app.add_middleware(middleware.BodyLimits, settings=chosen)
    app.add_middleware(middleware.Concurrency, settings=chosen)
    rates = Rates(
        chosen.max_requests_per_minute,
        chosen.max_anonymous_per_minute,
        chosen.max_failures_per_minute,
        is_replica=chosen.stateless,
    )
    logins = logins_of(chosen)
    app.add_middleware(Gate, require_keys=chosen.require_keys, rates=rates, logins=logins)
    app.add_middleware(middleware.Heads)
    app.add_middleware(Observation, metrics=metrics, telemetry=telemetry)
    if chosen.cors_origins:
        # Before everything: a preflight request carries no key.
        app.add_middleware(
            CORSMiddleware,
            allow_origins=chosen.cors_origins,
            allow_methods=("GET", "HEAD", "POST", "PATCH", "DELETE"),
            # Keys come in headers, never as cookies.
            allow_headers=("Authorization", "X-API-Key", "Idempotency-Key", "Prefer"),
            expose_headers=("Location", "ETag", "Retry-After", "X-Request-ID"),
        )
    if chosen.path_prefix:
        app.add_middleware(middleware.Prefix, prefix=chosen.path_prefix)
    routes = gated_routes()
    app.router.routes.extend(stateless_routes(routes) if chosen.stateless else routes)
    return app


SERVED: Final = frozenset(
    (
        *(("POST", f"/v1/{name}") for name in ("signature", "classify", "encode", "decode")),
        *(("GET", f"/v1/{name}") for name in ("limits", "models", "templates")),
        ("GET", "/v1/models/{name}"),
        ("GET", "/v1/templates/{template_id}"),
        ("GET", "/v1/templates/{template_id}/modes"),
        *(("GET", f"/health/{name}") for name in ("live", "ready")),
        ("GET", "/metrics"),
    )
)
"""Calls whose answer hangs on nothing that was sent before, by method and template."""


def stateless_routes(routes: Iterable[APIRoute]) -> list[APIRoute]:
    """Give routes that serve what needs no store, and refuse the rest by name.

    Parameters
    ----------
    routes : iterable of APIRoute
        Of a service with a store.
    """
    return [
        route
        if any((method, route.path) in SERVED for method in route.methods or ())
        else APIRoute(
            route.path,
            _refuse,
            response_model=None,
            methods=route.methods,
            include_in_schema=False,
            dependencies=[Depends(require_gate)],
        )
        for route in routes
    ]


def _refuse() -> NoReturn:
    raise errors.NeedsStoreError(
        "This service keeps nothing, and the call needs a store.",
        remedy="Send the sequence with POST /v1/signature or POST /v1/classify, which need none, "
        "or ask a service that was started without --stateless.",
    )
