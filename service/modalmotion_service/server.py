"""uvicorn, with a limit on how long a connection may take to say what it wants."""

from __future__ import annotations

import asyncio
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

from modalmotion.store import ResultStore
from modalmotion_service.app import create_app
from modalmotion_service.engine import open_engine
from modalmotion_service.observation import LOG_CONFIG
from modalmotion_service.settings import Settings
from modalmotion_service.spool import Spool


def protocol_with_deadline(header_seconds: float) -> type[H11Protocol]:
    """Make a protocol that closes connections whose request line and headers do not arrive.

    uvicorn limits how long an idle connection stays open after an answer, but not how long a
    new one may be silent, or spell its headers out.
    """

    class Deadline(H11Protocol):
        _timer: asyncio.TimerHandle | None = None

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            self._wait_for_headers()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            if self._is_at_work():
                self._stop_waiting()
            elif self._timer is None:
                # The next request on a connection that is kept open has begun.
                self._wait_for_headers()

        def connection_lost(self, exc: Exception | None) -> None:
            self._stop_waiting()
            super().connection_lost(exc)

        def _wait_for_headers(self) -> None:
            self._timer = self.loop.call_later(header_seconds, self._give_up)

        def _stop_waiting(self) -> None:
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None

        def _give_up(self) -> None:
            self._timer = None
            if not self._is_at_work():
                self.transport.close()

        def _is_at_work(self) -> bool:
            cycle: RequestResponseCycle | None = self.cycle
            return cycle is not None and not cycle.response_complete

    return Deadline


def run(settings: Settings, host: str, port: int) -> None:
    """Serve until told to stop; then answer what is under way, and let jobs finish.

    Raises
    ------
    StoreError
        If the folder cannot be used, such as by a second service.
    ClusterError
        If a scheduler is set and cannot be used.
    """
    # Said here, before uvicorn would say it with a traceback.
    with ResultStore(settings.data_dir):
        if settings.scheduler is not None:
            open_engine(settings, Spool(settings.data_dir / "spool").folder).shutdown()
    uvicorn.run(
        create_app(settings),
        host=host,
        port=port,
        http=protocol_with_deadline(settings.header_seconds),
        log_config=LOG_CONFIG,
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=int(settings.drain_seconds) + 1,
    )
