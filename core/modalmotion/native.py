"""The compiled library of the package, loaded by ctypes."""

from __future__ import annotations

import ctypes
import sys
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

_ENDINGS: Final = {"win32": "dll", "darwin": "dylib"}
PATH: Final = Path(__file__).parent / "_native" / f"modalmotion.{_ENDINGS.get(sys.platform, 'so')}"
"""Where the build puts the library."""


@cache
def library() -> ctypes.CDLL | None:
    """Load the library; None where it was not built."""
    return ctypes.CDLL(str(PATH)) if PATH.is_file() else None


def run(name: str, *given: np.ndarray[Any, Any] | int) -> int:
    """Call a function of the library.

    Parameters
    ----------
    name : str
    given : arrays and whole numbers
        Arrays are passed by their address: C-contiguous, of the function's types.

    Returns
    -------
    int
        What the function returns; nothing that counts from one that returns nothing.
    """
    loaded = library()
    assert loaded is not None  # noqa: S101 - who calls has looked
    return int(
        loaded[name](
            *(
                ctypes.c_void_p(x.ctypes.data) if isinstance(x, np.ndarray) else ctypes.c_int64(x)
                for x in given
            )
        )
    )
