"""The process of a server: its logs, its files, uvicorn in it."""

from __future__ import annotations

import asyncio
import gc
import logging
import logging.config
import os
import socket
import sys
from collections.abc import Callable
from typing import Final

import uvicorn
from fastapi import FastAPI

from modalmotion.errors import ParameterError
from modalmotion.store import ResultStore
from modalmotion_service.access.key_snapshot import KeySnapshot
from modalmotion_service.app import create_app
from modalmotion_service.commands.first_key import offer_first_key, secured, stated_key
from modalmotion_service.environment import unknown_variables
from modalmotion_service.http.connections import protocol_with_deadline, room_for_connections
from modalmotion_service.log_lines import log_config
from modalmotion_service.settings import Settings
from modalmotion_service.work.allocation import keep_freed_memory
from modalmotion_service.work.engine import open_engine
from modalmotion_service.work.temporary import temporary_folder

KEPT_BYTES: Final = 4 << 20
"""Freed memory that the server keeps: an upload comes in pieces of 256 KiB, each copied twice."""

logger = logging.getLogger(__name__)


def run(settings: Settings, host: str, port: int) -> None:
    """Serve until stopped; then answer open requests, and let jobs finish.

    Raises
    ------
    StoreError
        If the folder cannot be used, such as by a second service.
    ClusterError
        If an engine is set and cannot be used.
    """
    prepare_process(settings.log_level)
    if settings.stateless:
        chosen = secured(without_store(settings), host)
        require_keys_to_serve(chosen)
        run_app(create_app(chosen), chosen, host, port)
        return
    # Said here, before uvicorn would say it with a traceback.
    with ResultStore(settings.data_dir):
        if settings.engine != "processes":
            open_engine(settings).shutdown()
    chosen = secured(settings, host)
    stated_key(chosen.first_key_file)  # one that cannot be used is no matter of a running server
    app = create_app(chosen)

    def offer() -> None:
        offer_first_key(chosen, app.state.access.keys, app.state.access.audit)

    run_app(app, chosen, host, port, offer)


def without_store(settings: Settings) -> Settings:
    """Have what is under way lie in a folder that goes with the process.

    Raises
    ------
    ParameterError
        If an engine is set whose workers could not see that folder.
    """
    if settings.engine != "processes":
        raise ParameterError(
            f"A service that keeps nothing does its work itself, and the engine {settings.engine} "
            "is set.",
            remedy="Start more services with --stateless, or this one without.",
        )
    folder = temporary_folder() / "work"
    return settings.model_copy(update={"data_dir": folder})


def require_keys_to_serve(settings: Settings) -> None:
    """Check that somebody could use a service that needs keys and can make none.

    Raises
    ------
    ParameterError
        If there is no key, and no login either.
    """
    has_login = settings.oidc_issuer is not None
    if settings.require_keys and not has_login and not len(KeySnapshot(settings.read_only_dir)):
        raise ParameterError(
            "Keys are needed here, and --read-only-dir has none.",
            remedy="Make some with `modalmotion keys create` in a data folder, and name it or its "
            "backup as --read-only-dir.",
        )


def prepare_process(log_level: str) -> None:
    """Hide files that are written from other users, and log as JSON."""
    logging.config.dictConfig(log_config(log_level))
    os.umask(0o077)
    for name, nearest in unknown_variables():
        logger.warning("no such setting", extra={"variable": name, "nearest": nearest or None})


def run_app(
    app: FastAPI,
    settings: Settings,
    host: str,
    port: int,
    when_started: Callable[[], None] = lambda: None,
) -> None:
    """Serve an application as `run` serves the service's own."""
    # Modules, classes and routes stay for good, and the collector need not walk them.
    keep_freed_memory(KEPT_BYTES, in_one=True)
    gc.enable()
    connections, at_once = room_for_connections(settings.max_connections)
    config = uvicorn.Config(
        app,
        host=host,
        port=port,
        http=protocol_with_deadline(
            settings.header_seconds,
            settings.idle_seconds,
            connections,
        ),
        backlog=at_once,
        log_config=log_config(settings.log_level),
        access_log=False,
        server_header=False,
        forwarded_allow_ips=settings.trusted_proxies,
        timeout_graceful_shutdown=int(settings.drain_seconds) + 1,
    )
    server = _Server(config, when_started)
    server.run()
    if not server.started:
        sys.exit(3)  # as uvicorn's own command does


class _Server(uvicorn.Server):
    """Calls back once it listens: a start that fails makes and shows no key."""

    def __init__(self, config: uvicorn.Config, when_started: Callable[[], None]) -> None:
        super().__init__(config)
        self._when_started = when_started

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Open the application and the port."""
        await super().startup(sockets)
        if self.started:
            await asyncio.to_thread(self._when_started)
