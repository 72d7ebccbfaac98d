"""What runs in a worker: it answers requests until its socket closes.

An empty request asks whether it is there.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import pickle
import resource
import select
import socket
import threading
from typing import Final

from modalmotion_service.work.answers import answer_of
from modalmotion_service.work.upload import begin_parsers

# Of mallopt(3). The C library of the GNU project gives freed memory back to the system above
# 128 KiB, and takes it back page by page: 900 page faults for each signature of 1 MB in a worker,
# and 400 to 700 in the server that receives it.
_M_TRIM_THRESHOLD: Final = -1
_M_MMAP_THRESHOLD: Final = -3
_M_ARENA_MAX: Final = -8


def keep_freed_memory(kept_bytes: int, *, in_one: bool = False) -> None:
    """Keep some freed memory for what comes next, and never look again at what is here.

    Where the C library knows no such setting it stays as it is.

    Parameters
    ----------
    kept_bytes : int
        At most; blocks of half of it and more go back to the system at once.
    in_one : bool
        Whether all threads of the process, of which no two run at the same time, share what is
        kept; otherwise some have their own.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_TRIM_THRESHOLD, kept_bytes)
        mallopt(_M_MMAP_THRESHOLD, kept_bytes // 2)
        if in_one:
            mallopt(_M_ARENA_MAX, 1)
    # Modules and classes stay for good: the collector need not walk them. It does not now either,
    # for in a forked process each object that it touches is copied.
    gc.freeze()


PREFIX: Final = 8
"""Bytes of the length before a request and an answer, little-endian."""
FIRST_PIECE: Final = 1 << 16
"""Of an answer at a time: most are whole in the first piece."""

# Freed memory that a worker keeps: a signature of 1 MB needs 4 MB for a moment.
_KEPT_BYTES: Final = 8 << 20

# A third of a core's share beside what is as usual: less starves workers on a machine with others.
_NICENESS: Final = 5


def work(ours: socket.socket, memory_bytes: int, is_batch: bool) -> None:
    """Answer requests until the socket closes.

    Parameters
    ----------
    ours : socket
    memory_bytes : int
        Of address space that it may take.
    is_batch : bool
        Whether it leaves a core to what wakes up.
    """
    if is_batch:
        with contextlib.suppress(OSError, AttributeError):
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
        os.nice(_NICENESS)
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    keep_freed_memory(_KEPT_BYTES)
    answer(ours, b"")
    is_begun = False
    while prefix := ours.recv(PREFIX, socket.MSG_WAITALL):
        if not (length := int.from_bytes(prefix, "little")):
            answer(ours, answer_of(os.getpid, (), {}))
            continue
        if not is_begun:
            # With the first task, before anything of it is read, and before there are threads.
            begin_parsers()
            threading.Thread(target=_end_with_server, args=[ours], daemon=True).start()
            is_begun = True
        # From our own server: only answers come from where strangers' files are read.
        function, args, kwargs = pickle.loads(ours.recv(length, socket.MSG_WAITALL))  # noqa: S301
        answer(ours, answer_of(function, args, kwargs))
        del function, args, kwargs
    os._exit(0)


def answer(ours: socket.socket, data: bytes) -> None:
    """Send an answer."""
    # Whoever waits wakes up for each piece.
    ours.sendall(len(data).to_bytes(PREFIX, "little") + data[:FIRST_PIECE])
    if rest := memoryview(data)[FIRST_PIECE:]:
        ours.sendall(rest)


def _end_with_server(ours: socket.socket) -> None:
    # A server that is killed leaves its workers behind: what they would still write may by then
    # be another worker's work.
    poll = select.poll()
    poll.register(ours, select.POLLRDHUP)
    poll.poll()
    os._exit(1)
