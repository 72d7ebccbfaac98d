"""A way to the service that fails as told: connections cut, answers lost, kept waiting."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections import deque
from enum import Enum
from typing import Self


class Fault(Enum):
    NONE = "passes everything on"
    REFUSE = "closes the connection at once"
    CUT_UPLOAD = "passes half of the body on, then closes both sides"
    LOSE_ANSWER = "has the service answer, and closes without passing it on"
    TRUNCATE = "passes the first half of the answer on"
    STALL = "takes the request and says nothing"
    DRIP = "passes the answer on byte by byte, for ever slower than anybody waits"
    UNAVAILABLE = "answers 503 itself"
    BUSY = "answers 429 itself, with Retry-After"
    NONSENSE = "answers 502 in HTML, as a proxy does"


_OWN_ANSWERS = {
    Fault.UNAVAILABLE: b"HTTP/1.1 503 Service Unavailable\r\n",
    Fault.BUSY: b"HTTP/1.1 429 Too Many Requests\r\nRetry-After: 2\r\n",
    Fault.NONSENSE: b"HTTP/1.1 502 Bad Gateway\r\nContent-Type: text/html\r\n",
}


class FlakyWay:
    """Listens on a port of its own; each connection meets the next fault, then none."""

    def __init__(self, service_port: int) -> None:
        self.faults: deque[Fault] = deque()
        self.n_requests = 0
        self._service_port = service_port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._open: list[socket.socket] = []
        self._ended = threading.Event()
        threading.Thread(target=self._accept, daemon=True).start()

    @property
    def base(self) -> str:
        return f"http://127.0.0.1:{self._listener.getsockname()[1]}"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        # Closing alone does not wake the thread that accepts.
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        for one in [self._listener, *self._open]:
            one.close()

    def _accept(self) -> None:
        while not self._ended.is_set():
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            self._open.append(client)
            fault = self.faults.popleft() if self.faults else Fault.NONE
            threading.Thread(target=self._serve, args=[client, fault], daemon=True).start()

    def _serve(self, client: socket.socket, fault: Fault) -> None:
        with contextlib.suppress(OSError, EOFError), client:
            self.n_requests += 1
            if fault is Fault.REFUSE:
                return
            head, body = _request(client)
            if fault in _OWN_ANSWERS:
                client.sendall(_OWN_ANSWERS[fault] + b"Content-Length: 3\r\n\r\nno!")
            elif fault is Fault.STALL:
                self._ended.wait(60)
            elif fault is Fault.CUT_UPLOAD:
                with socket.create_connection(("127.0.0.1", self._service_port)) as service:
                    service.sendall(head + body[: len(body) // 2])
            else:
                self._answer(client, fault, self._ask(head + body))

    def _ask(self, request: bytes) -> bytes:
        closing = request.replace(b"\r\n", b"\r\nConnection: close\r\n", 1)
        with socket.create_connection(("127.0.0.1", self._service_port)) as service:
            service.sendall(closing)
            return b"".join(iter(lambda: service.recv(1 << 16), b""))

    def _answer(self, client: socket.socket, fault: Fault, answer: bytes) -> None:
        if fault is Fault.TRUNCATE:
            client.sendall(answer[: answer.index(b"\r\n\r\n") + 4 + 10])
        elif fault is Fault.DRIP:
            for byte in answer:
                client.sendall(bytes([byte]))
                if self._ended.wait(0.002):
                    return
        elif fault is Fault.NONE:
            client.sendall(answer)


def _request(client: socket.socket) -> tuple[bytes, bytes]:
    """Head and body of a request, with a length or in chunks."""
    data = b""
    while b"\r\n\r\n" not in data:
        data += _more(client)
    head, _, body = data.partition(b"\r\n\r\n")
    fields = dict(line.lower().split(b": ", 1) for line in head.split(b"\r\n")[1:] if b": " in line)
    if b"chunked" in fields.get(b"transfer-encoding", b""):
        while not body.endswith(b"0\r\n\r\n"):
            body += _more(client)
    else:
        while len(body) < int(fields.get(b"content-length", b"0")):
            body += _more(client)
    return head + b"\r\n\r\n", body


def _more(client: socket.socket) -> bytes:
    piece = client.recv(1 << 16)
    if not piece:
        raise EOFError
    return piece
