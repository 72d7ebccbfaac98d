"""How a worker, which does one task after another, keeps its memory."""

from __future__ import annotations

import ctypes
import gc
from typing import Final

# Of mallopt(3). The C library of the GNU project gives freed memory back to the system above
# 128 KiB, and takes it back page by page: 900 page faults for each signature of 1 MB.
_M_TRIM_THRESHOLD: Final = -1
_M_MMAP_THRESHOLD: Final = -3


def keep_freed_memory(kept_bytes: int) -> None:
    """Keep some freed memory for what comes next, and never look again at what is here.

    Where the C library knows no such setting it stays as it is.

    Parameters
    ----------
    kept_bytes : int
        At most; blocks of half of it and more go back to the system at once.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_TRIM_THRESHOLD, kept_bytes)
        mallopt(_M_MMAP_THRESHOLD, kept_bytes // 2)
    # Modules and classes stay for good: the collector need not walk them. It does not now either,
    # for in a forked process each object that it touches is copied.
    gc.freeze()
