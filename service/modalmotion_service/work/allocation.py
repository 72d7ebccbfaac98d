"""How a process that does one thing after another keeps its memory."""

from __future__ import annotations

import ctypes
import gc
from typing import Final

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
