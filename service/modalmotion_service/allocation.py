"""How a process that answers one request after another keeps its memory."""

from __future__ import annotations

import ctypes
import gc
from typing import Final

# Of mallopt(3). The C library of the GNU project gives freed memory back to the system above
# 128 KiB, and takes it back page by page: 900 page faults for each signature of 1 MB.
_M_TRIM_THRESHOLD: Final = -1
_M_MMAP_THRESHOLD: Final = -3
_KEPT_BYTES: Final = 16 << 20
_LARGE_BYTES: Final = 4 << 20


def settle() -> None:
    """Keep up to 16 MiB of freed memory for what comes next, and never look again at what is here.

    Blocks of 4 MiB and more go back to the system at once. Where the C library knows no such
    setting it stays as it is.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)
        mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
    # Modules, classes and routes stay for good: the collector need not walk them. It does not
    # now either, for in a forked process each object that it touches is copied.
    gc.freeze()
