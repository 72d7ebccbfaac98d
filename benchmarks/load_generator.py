"""Requests one after another over several connections, as fast as they are answered.

Over plain sockets, so that the generator takes little of the machine it shares with the server.
"""

from __future__ import annotations

import re
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Final

_LENGTH: Final = re.compile(rb"\r\ncontent-length: (\d+)", re.IGNORECASE)


def request(method: str, target: str, body: bytes = b"", **headers: str) -> bytes:
    """Write a request as it goes over the wire."""
    lines = [f"{method} {target} HTTP/1.1", "Host: localhost", f"Content-Length: {len(body)}"]
    lines += [f"{name.replace('_', '-')}: {value}" for name, value in headers.items()]
    return "\r\n".join([*lines, "", ""]).encode() + body


def load(port: int, sent: bytes, n_connections: int, seconds: float) -> tuple[int, float]:
    """Send the same request again and again over each of several connections.

    Returns
    -------
    int, float
        Requests that were answered by 200, for any other ends the load; seconds that it took.
    """
    start = time.perf_counter()

    def send_until_the_end(_: int) -> int:
        n = 0
        with socket.create_connection(("127.0.0.1", port), timeout=60) as connection:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            while time.perf_counter() < start + seconds:
                connection.sendall(sent)
                _receive_answer(connection)
                n += 1
        return n

    with ThreadPoolExecutor(n_connections) as threads:
        n = sum(threads.map(send_until_the_end, range(n_connections)))
    return n, time.perf_counter() - start


def _receive_answer(connection: socket.socket) -> None:
    data = b""
    while (end := data.find(b"\r\n\r\n")) < 0:
        data += _receive(connection)
    assert data.startswith(b"HTTP/1.1 200"), data[:1000]
    length = _LENGTH.search(data[:end])
    assert length is not None
    left = int(length[1]) - (len(data) - end - 4)
    while left > 0:
        left -= len(_receive(connection))


def _receive(connection: socket.socket) -> bytes:
    piece = connection.recv(1 << 18)
    assert piece, "the server closed the connection"
    return piece
