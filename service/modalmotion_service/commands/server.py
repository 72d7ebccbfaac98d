"""The process of a server: its logs, its files, its first key, uvicorn in it."""

import asyncio
import contextlib
import fcntl
import gc
import logging
import logging.config
import os
import shutil
import socket
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

import click
import uvicorn
from fastapi import FastAPI

from modalmotion.errors import ParameterError
from modalmotion.store import ResultStore
from modalmotion_service.access import audit, rates, scopes
from modalmotion_service.access.keys import KeyRing, KeySnapshot, parts_of
from modalmotion_service.app import create_app
from modalmotion_service.http.connections import protocol_with_deadline, room_for_connections
from modalmotion_service.log_lines import log_config
from modalmotion_service.settings import Settings, unknown_variables
from modalmotion_service.work import pool, worker


def secured(settings: Settings, host: str) -> Settings:
    """Demand keys where the address to listen on can be reached from other machines."""
    if rates.is_loopback(host):
        return settings
    return settings.model_copy(update={"require_keys": True})


def offer_first_key(settings: Settings, ring: KeyRing, log: audit.AuditLog) -> None:
    """Make a key with every scope where keys are needed and none was ever made.

    It is shown, unless it was read from a file that the settings name. Keys and audit log are those
    that the process has open: a file that it opened and closed once more would lose SQLite's locks.

    Raises
    ------
    ParameterError
        As of `stated_key`.
    """
    if not settings.require_keys or ring.all():
        return
    stated = stated_key(settings.first_key_file)
    made = ring.create(scopes.LOCAL, frozenset(scopes.Scope), note="first key", token=stated)
    key, token = audit.note_key(made, ring, log)
    if stated:
        return
    # To standard output, apart from the log, which goes to standard error.
    click.echo(
        "\n  This service needs keys, and there was none. The first one, with every scope;\n"
        "  it is shown this once and kept as a hash only:\n\n"
        f"      {token}\n\n"
        f"  Make others with `modalmotion keys create`; take it back with "
        f"`modalmotion keys revoke {key.id}`.\n"
    )


def stated_key(file: Path | None) -> str:
    """Read a key from a file's first line; empty where no file is named.

    Raises
    ------
    ParameterError
        If the file cannot be read, or begins with no key.
    """
    if file is None:
        return ""
    try:
        # A little more than a key: whatever else the file has stays unread.
        with file.open(encoding="ascii") as text:
            stated = text.readline(200).strip()
        parts_of(stated)
    except (OSError, ValueError, ParameterError) as error:
        raise ParameterError(
            f"MODALMOTION_FIRST_KEY_FILE names {str(file)!r}, which has no key: "
            f"{getattr(error, 'message', error)}",
            remedy="Mount the secret there, readable by the service's user; make it with "
            "`modalmotion keys create --owner local --scopes read --data-dir new-folder`.",
        ) from None
    return stated


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
            pool.open_engine(settings).shutdown()
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
    worker.keep_freed_memory(KEPT_BYTES, in_one=True)
    gc.enable()
    connections, at_once = room_for_connections(settings.max_connections)
    config = uvicorn.Config(
        app,
        host=host,
        port=port,
        http=protocol_with_deadline(settings, connections),
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


_TEMPORARY: Final = "modalmotion-"


def temporary_folder() -> Path:
    """Make a folder that is locked while this process lives, and remove those that nobody holds."""
    parent = Path(tempfile.gettempdir())
    for left in parent.glob(f"{_TEMPORARY}*"):
        # Another user's, in use, or gone meanwhile.
        with contextlib.suppress(OSError), contextlib.ExitStack() as stack:
            stack.callback(os.close, _locked(left))
            shutil.rmtree(left)
    # Named when it is locked: whoever sweeps in between would take it for one that was left behind.
    made = Path(tempfile.mkdtemp(prefix=f".{_TEMPORARY}"))
    _locked(made)
    return made.rename(parent / made.name[1:])


def _locked(folder: Path) -> int:
    """Lock a folder until the descriptor that this gives is closed."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
