"""Requests one after another over several connections, as fast as they are answered.

Over plain sockets, so that the generator takes little of the machine it shares with the server.
"""

from __future__ import annotations

import re
import socket
import threading
import time
from collections import defaultdict
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Final

_LENGTH: Final = re.compile(rb"\r\ncontent-length: (\d+)", re.IGNORECASE)
_TIMING: Final = re.compile(rb"\r\nserver-timing: ([^\r]*)", re.IGNORECASE)


@dataclass
class Load:
    """What came back.

    Parameters
    ----------
    seconds : float
        That requests were sent for.
    latencies : list of float, s
        One for each request.
    stages : dict of float, ms
        By stage of Server-Timing, added up over requests.
    """

    seconds: float = 0.0
    latencies: list[float] = field(default_factory=list)
    stages: dict[str, float] = field(default_factory=lambda: defaultdict(float))

    @property
    def rate(self) -> float:
        """Requests a second."""
        return len(self.latencies) / self.seconds

    def stage(self, name: str) -> float:
        """Milliseconds of a stage, a request."""
        return self.stages[name] / len(self.latencies)

    def add(self, other: Load) -> None:
        """Take in what another run gave."""
        self.seconds += other.seconds
        self.latencies += other.latencies
        for name, spent in other.stages.items():
            self.stages[name] += spent


def post(target: str, body: bytes, headers: Mapping[str, str]) -> bytes:
    """Write a request as it goes over the wire, but for its body."""
    lines = [f"POST {target} HTTP/1.1", "Host: localhost", f"Content-Length: {len(body)}"]
    lines += [f"{name}: {value}" for name, value in headers.items()]
    return "\r\n".join([*lines, "", ""]).encode()


def load(port: int, head: bytes, body: bytes, n_connections: int, seconds: float) -> Load:
    """Send the same request again and again over each of several connections."""
    total, lock = Load(seconds), threading.Lock()
    start = time.perf_counter()

    def send_until_the_end(_: int) -> None:
        with socket.create_connection(("127.0.0.1", port), timeout=60) as connection:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            while time.perf_counter() < start + seconds:
                began = time.perf_counter()
                connection.sendall(head)
                connection.sendall(body)
                timing = _answer(connection)
                with lock:
                    total.latencies.append(time.perf_counter() - began)
                    for entry in timing.split(", "):
                        stage, duration = entry.split(";dur=")
                        total.stages[stage] += float(duration)

    with ThreadPoolExecutor(n_connections) as threads:
        list(threads.map(send_until_the_end, range(n_connections)))
    total.seconds = time.perf_counter() - start
    return total


def _answer(connection: socket.socket) -> str:
    """Read an answer to its end; give its Server-Timing."""
    data = b""
    while (end := data.find(b"\r\n\r\n")) < 0:
        data += _receive(connection)
    head = data[:end]
    assert head.startswith(b"HTTP/1.1 200"), data[:1000]
    length, timing = _LENGTH.search(head), _TIMING.search(head)
    assert length is not None
    assert timing is not None
    left = int(length[1]) - (len(data) - end - 4)
    while left > 0:
        left -= len(_receive(connection))
    return timing[1].decode()


def _receive(connection: socket.socket) -> bytes:
    piece = connection.recv(1 << 18)
    assert piece, "the server closed the connection"
    return piece
