"""What keys, scopes, rates and the audit log cost a small request."""

from __future__ import annotations

import asyncio
import io
import json
import statistics
import tempfile
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import numpy as np
from measure import Table
from starlette.types import ASGIApp, Message

from modalmotion_service.access.keys import KeyRing
from modalmotion_service.access.principal import LOCAL, LOCAL_PRINCIPAL, attach
from modalmotion_service.access.scopes import Scope, target_of
from modalmotion_service.app import create_app
from modalmotion_service.audit.entry import Event
from modalmotion_service.audit.notes import Notes
from modalmotion_service.http.gate import Access, Gate
from modalmotion_service.settings import Settings

N_ROUNDS = 60
AT_ONCE = 16

Ask = Callable[[], Awaitable[int]]


class _Unwritten:
    """An audit log that keeps nothing."""

    async def note(self, event: Event) -> None:
        pass


class _OneByOne:
    """An audit log that commits every entry by itself, and has everybody wait meanwhile."""

    def __init__(self, log: Notes) -> None:
        self.log = log

    async def note(self, event: Event) -> None:
        self.log.append([event])


def run(_folder: Path | None = None) -> list[Table]:
    """Time the summary of a sequence with and without the parts of the gate."""
    with tempfile.TemporaryDirectory() as folder:
        return [asyncio.run(_run(Path(folder)))]


async def _run(folder: Path) -> Table:
    settings = Settings(data_dir=folder, workers=1, max_requests_per_minute=10**9)
    app = create_app(settings)
    table = Table(
        f"GET /v1/sequences/{{id}} within the process, medians of {N_ROUNDS} rounds",
        ("", "one after another", f"{AT_ONCE} at once, each"),
    )
    async with app.router.lifespan_context(app):
        with KeyRing(folder) as ring:
            token = ring.create(LOCAL, frozenset(Scope))[1]
        _, body = await _send(app, "POST", "/v1/sequences", token, _sequence())
        path = f"/v1/sequences/{json.loads(body)['id']}"
        access: Access = app.state.access
        gate = _gate(app)

        async def whole(log: Any) -> int:
            app.state.access = Access(access.keys, log)
            return (await _send(app, "GET", path, token))[0]

        async def behind_the_gate() -> int:
            async def inner(scope: Any, receive: Any, send: Any) -> None:
                attach(scope, LOCAL_PRINCIPAL)
                target = target_of("GET", path)
                assert target is not None
                scope.update({"app": app, "modalmotion.route": target.template})
                await gate.app(scope, receive, send)

            return (await _send(inner, "GET", path, token))[0]

        one_by_one = _OneByOne(access.audit)
        variants: dict[str, Ask] = {
            "behind the gate": behind_the_gate,
            "keys, scopes, rates; no audit": lambda: whole(_Unwritten()),
            "all, entries committed together": lambda: whole(access.audit),
            "all, each entry by itself": lambda: whole(one_by_one),
        }
        times = await _side_by_side(variants)
        app.state.access = access
        base = times["behind the gate"]
        for name, (alone, together) in times.items():
            table.add(
                name,
                f"{1e3 * alone:.2f} ms ({alone / base[0]:.2f})",
                f"{1e3 * together:.2f} ms ({together / base[1]:.2f})",
            )
    return table


async def _side_by_side(variants: dict[str, Ask]) -> dict[str, tuple[float, float]]:
    alone: dict[str, list[float]] = {name: [] for name in variants}
    together: dict[str, list[float]] = {name: [] for name in variants}
    for _ in range(N_ROUNDS):
        for name, ask in variants.items():
            for samples, at_once in ((alone, 1), (together, AT_ONCE)):
                start = time.perf_counter()
                statuses = await asyncio.gather(*(ask() for _ in range(at_once)))
                samples[name].append((time.perf_counter() - start) / at_once)
                assert set(statuses) == {200}
    return {
        name: (statistics.median(alone[name]), statistics.median(together[name]))
        for name in variants
    }


def _gate(app: Any) -> Gate:
    middleware = app.middleware_stack or app.build_middleware_stack()
    app.middleware_stack = middleware
    while not isinstance(middleware, Gate):
        middleware = middleware.app
    return middleware


async def _send(
    app: ASGIApp, method: str, path: str, token: str, body: bytes = b""
) -> tuple[int, bytes]:
    scope = {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "method": method,
        "scheme": "http",
        "path": path,
        "raw_path": path.encode(),
        "query_string": b"",
        "root_path": "",
        "headers": [(b"host", b"localhost"), (b"authorization", f"Bearer {token}".encode())],
        "client": ("127.0.0.1", 1),
        "server": ("127.0.0.1", 8000),
    }
    status, answer, sent = 0, b"", False

    async def receive() -> Message:
        nonlocal sent
        if sent:
            await asyncio.sleep(3600)
        sent = True
        return {"type": "http.request", "body": body, "more_body": False}

    async def send(message: Message) -> None:
        nonlocal status, answer
        status = message.get("status", status)
        answer += message.get("body", b"")

    await app(scope, receive, send)
    return status, answer


def _sequence() -> bytes:
    buffer = io.BytesIO()
    vertices = np.random.default_rng(1).normal(size=(4, 64, 3))
    np.savez(buffer, vertices=vertices, grid=(8, 8), topology="cup")
    return buffer.getvalue()


if __name__ == "__main__":
    for found in run():
        print(found)
