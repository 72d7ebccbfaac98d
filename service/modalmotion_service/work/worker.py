"""What runs in a worker: it answers requests until its socket closes.

Workers serve all owners, and what is computed once for one would be there sooner for the next: from
the time of an answer one could tell whether another had sent the same surface.
"""

import contextlib
import ctypes
import gc
import inspect
import os
import pickle
import resource
import select
import socket
import sys
import threading
from collections.abc import Callable
from typing import Any, Final

from modalmotion_service.work import answers, engine, upload

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
    upload.confine_parsers()
    answer(ours, b"")
    is_begun = False
    while prefix := ours.recv(engine.PREFIX, socket.MSG_WAITALL):
        if not is_begun:
            threading.Thread(target=_end_with_server, args=[ours], daemon=True).start()
            is_begun = True
        # From our own server: only answers come from where strangers' files are read.
        request = ours.recv(int.from_bytes(prefix, "little"), socket.MSG_WAITALL)
        function, args, kwargs = pickle.loads(request)  # noqa: S301
        answer(ours, answers.answer_of(function, args, kwargs))
        del request, function, args, kwargs
    os._exit(0)


def answer(ours: socket.socket, data: bytes) -> None:
    """Send an answer."""
    ours.sendall(len(data).to_bytes(engine.PREFIX, "little") + data)


def _end_with_server(ours: socket.socket) -> None:
    # A server that is killed leaves its workers behind: what they would still write may by then
    # be another worker's work.
    poll = select.poll()
    poll.register(ours, select.POLLRDHUP)
    poll.poll()
    os._exit(1)


# Of the program itself, or by paths, which are in one owner's folder.
_OF_NOBODY: Final = frozenset({"_load_shipped", "_reader", "result_type"})

_served: list[str] = []


def serve(owner: str, function: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """Do a task for an owner, in a worker, which first forgets what it knows of others."""
    if _served and _served[-1] != owner:
        for cache in remembering():
            cache.cache_clear()
        upload.end_parser()
    _served[:] = [owner]
    return function(*args, **kwargs)


def remembering() -> list[Any]:
    """List the caches of our modules whose keys a user's data may have a part in."""
    ours = ("modalmotion", "modalmotion_service")
    modules = [one for name, one in list(sys.modules.items()) if name.partition(".")[0] in ours]
    values = [value for module in modules for value in list(vars(module).values())]
    caches = [value for value in values if hasattr(value, "cache_clear")]
    return [
        one
        for one in caches
        if one.__name__ not in _OF_NOBODY and inspect.signature(one).parameters
    ]


def payload_of(terms: engine.Terms, function: Callable[..., Any], args: Any, kwargs: Any) -> bytes:
    """Write a task, as one that says whose work it is where it is somebody's."""
    if terms.owner:
        function, args = serve, (terms.owner, function, *args)
    return pickle.dumps((function, args, kwargs))
