"""Tasks for worker processes, which import them by name."""

from __future__ import annotations

import os
import signal
import socket
import sys
import time
from pathlib import Path
from types import FrameType

import numpy as np

from modalmotion.errors import NonFiniteError
from modalmotion.limits import DEFAULT_LIMITS
from modalmotion_service.work.answers import to_bytes
from modalmotion_service.work.engine import PREFIX
from modalmotion_service.work.tasks.files import whole_file
from modalmotion_service.work.upload import parser_for
from modalmotion_service.work.worker import remembering


def swallow_memory() -> int:
    return int(np.ones(1_000_000_000).sum())


def hang() -> None:
    time.sleep(60)


def die_once(mark: Path) -> str:
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def die_while_writing(path: Path) -> None:
    with whole_file(path) as temporary:
        temporary.touch()
        os._exit(1)


def refuse() -> None:
    raise NonFiniteError("text", remedy="advice", frame=3, vertex=4, details={"count": 1})


def slow_mark(mark: Path, seconds: float) -> str:
    mark.touch()
    time.sleep(seconds)
    return "done"


def wait_for(gate: Path) -> None:
    while not gate.exists():
        time.sleep(0.01)


def is_running(pid: int) -> bool:
    try:
        status = Path(f"/proc/{pid}/stat").read_text()
    except FileNotFoundError:
        return False
    # One that nobody has asked after stays in the table as a zombie.
    return status.rpartition(")")[2].split()[0] != "Z"


def short(number: int, seconds: float) -> int:
    time.sleep(seconds)
    return number


def spin() -> None:
    while True:
        pass


def note(path: Path, name: str, seconds: float = 0.0) -> str:
    time.sleep(seconds)
    with path.open("a") as file:
        file.write(f"{name}\n")
    return name


def remembered() -> dict[str, int]:
    """How many entries each cache has that a user's data may have a part in, but empty ones."""
    sizes = {cache.__wrapped__.__name__: cache.cache_info().currsize for cache in remembering()}
    return {name: size for name, size in sizes.items() if size}


def parse_and_tell(data: bytes, times: int = 1) -> list[int]:
    """Have a file parsed; numbers of the worker and of the parser that lives."""
    for _ in range(times):
        parser_for(DEFAULT_LIMITS).parse("hdf5", data)
    own = os.getpid()
    children = Path(f"/proc/{own}/task/{own}/children").read_text()
    return [own, *map(int, children.split())]


def answer_twice() -> int:
    """Answer 2, 3 and then its own 4, as a worker that was taken over might."""
    frame: FrameType | None = sys._getframe()
    while frame is not None:
        if isinstance(ours := frame.f_locals.get("ours"), socket.socket):
            # As one, so that the second is there when the first is.
            data = to_bytes(2), to_bytes(3)
            ours.sendall(b"".join(len(one).to_bytes(PREFIX, "little") + one for one in data))
            return 4
        frame = frame.f_back
    raise AssertionError("no socket")
