"""Connections of uvicorn: how many, how long they may be silent, and what is no HTTP."""

import asyncio
import contextlib
import resource
from typing import Any, Final, cast

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

from modalmotion.errors import MalformedFileError
from modalmotion_service.http.problems import problem_of
from modalmotion_service.settings import Settings

# Open files that a process asks for, where it may have that many; and connections that uvicorn
# has asyncio accept in one go by default.
_MOST_FILES: Final = 65_536
_MOST_AT_ONCE: Final = 2048


def room_for_connections(most: int) -> tuple[int, int]:
    """Allow this process more open files, and return how many of them connections may take.

    Where a connection cannot be accepted for want of a file, no result can be read or stored
    either, and asyncio says so a thousand times a second.

    Returns
    -------
    connections : int
        At most `most`, and a third of all files: the rest is for stores and uploads, and for
    at_once : int
        that are accepted in one go, some times over before the first of them is counted.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _MOST_FILES if hard == resource.RLIM_INFINITY else min(hard, _MOST_FILES)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
        soft = wanted
    files = _MOST_FILES if soft == resource.RLIM_INFINITY else soft
    return max(1, min(most, files // 3)), max(8, min(_MOST_AT_ONCE, files // 8))


def protocol_with_deadline(settings: Settings, most: int) -> type[H11Protocol]:
    """Make a protocol that closes connections whose client does not do its part.

    uvicorn limits how long an idle connection stays open after an answer, but neither how long a
    new one may be silent, or spell its headers out, nor how long an answer may wait for a client
    that does not read it.

    Parameters
    ----------
    settings : Settings
        `header_seconds` for a request line and headers to arrive, `idle_seconds` for a client to
        take the next 48 KiB of an answer.
    most : int
        Connections. Beyond them the one that has been silent longest is closed: a client that
        opens many and sends nothing keeps nobody else out.
    """
    quiet: dict[H11Protocol, None] = {}

    class Deadline(H11Protocol):
        _timer: asyncio.TimerHandle | None = None
        _unread: asyncio.TimerHandle | None = None
        _is_deaf = False

        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            self._answer_in_full, self.app = self.app, self._answer

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            quiet[self] = None
            self._wait_for_headers()
            if len(self.connections) > most:
                longest = next(iter(quiet))
                del quiet[longest]
                longest.transport.abort()

        def pause_writing(self) -> None:
            super().pause_writing()
            # Abort, not close: closing waits until everything is read.
            self._unread = self.loop.call_later(settings.idle_seconds, self.transport.abort)

        def resume_writing(self) -> None:
            super().resume_writing()
            if self._unread is not None:
                self._unread.cancel()
                self._unread = None

        def data_received(self, data: bytes) -> None:
            if self._is_deaf:
                return
            super().data_received(data)
            if self._is_at_work():
                quiet.pop(self, None)
                self._stop_waiting()
            elif self._timer is None:
                # The next request on a connection that is kept open has begun.
                self._wait_for_headers()

        async def _answer(self, scope: Any, receive: Any, send: Any) -> None:
            cycle: RequestResponseCycle | None = self.cycle

            async def sent(message: Any) -> None:
                if cycle is not None and self._is_early():
                    if message["type"] == "http.response.start":
                        # Or the client's next request would be lost on this connection.
                        headers = [(n, v) for n, v in message["headers"] if n != b"connection"]
                        message = {**message, "headers": [*headers, (b"connection", b"close")]}
                    elif not message.get("more_body", False):
                        # Closed while something comes in, it would be reset, and the answer lost.
                        cycle.transport = cast("Any", _LeftOpen(self.transport))
                await send(message)

            await self._answer_in_full(scope, receive, sent)

        def _is_early(self) -> bool:
            return self.conn.their_state is h11.SEND_BODY and not self.transport.is_closing()

        def on_response_complete(self) -> None:
            # The latest of all.
            quiet[self] = None
            if self._is_early():
                # Answered before the body was there, as whoever has no key is: what still comes
                # is let in, so that the answer can be read, and not looked at. A chunk is 20 us.
                self._is_deaf = True
                self.transport.write_eof()
                self.flow.resume_reading()
                self._stop_waiting()
                self._wait_for_headers()
                return
            super().on_response_complete()

        def connection_lost(self, exc: Exception | None) -> None:
            quiet.pop(self, None)
            self._stop_waiting()
            if self._unread is not None:
                self._unread.cancel()
            super().connection_lost(exc)

        def send_400_response(self, msg: str) -> None:
            # uvicorn's own is plain text, and fails where an answer is under way already.
            if self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE):
                remedy = "Send a request as RFC 9112 has it; its head is at most 64 KiB."
                answer = problem_of(MalformedFileError(msg, remedy=remedy))
                headers = [*answer.raw_headers, (b"connection", b"close")]
                response = h11.Response(status_code=400, headers=headers, reason=b"Bad Request")
                self.transport.write(self.conn.send(response))
                # An answer to HEAD has no body, and h11 lets none pass.
                with contextlib.suppress(h11.LocalProtocolError):
                    self.transport.write(self.conn.send(h11.Data(data=bytes(answer.body))))
            self.transport.close()

        def _wait_for_headers(self) -> None:
            self._timer = self.loop.call_later(settings.header_seconds, self._give_up)

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


class _LeftOpen:
    """A transport whose closing is left to the protocol.

    Parameters
    ----------
    transport : asyncio.Transport
    """

    def __init__(self, transport: Any) -> None:
        self.write, self.is_closing = transport.write, transport.is_closing

    def close(self) -> None:
        """Do nothing."""
