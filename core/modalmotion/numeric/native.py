"""The compiled library of the package, loaded by ctypes."""

import ctypes
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

_ENDINGS: Final = {"win32": "dll", "darwin": "dylib"}
_PACKAGE: Final = Path(__file__).parents[1]
PATH: Final = _PACKAGE / "_native" / f"modalmotion.{_ENDINGS.get(sys.platform, 'so')}"
"""Where the build puts the library."""

_COMPILER: Final = _PACKAGE.parents[1] / "tools" / "compile_library.py"


@cache
def library() -> ctypes.CDLL:
    """Load the library; in a checkout it is compiled first if a source is newer.

    Raises
    ------
    OSError
        If it was not built.
    """
    if _COMPILER.is_file():
        built = PATH.stat().st_mtime if PATH.is_file() else 0.0
        if any(source.stat().st_mtime > built for source in _PACKAGE.glob("*/native/*.[ch]")):
            subprocess.run([sys.executable, str(_COMPILER)], check=True)  # noqa: S603
    return ctypes.CDLL(str(PATH))


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
    return int(
        library()[name](
            *(
                ctypes.c_void_p(x.ctypes.data) if isinstance(x, np.ndarray) else ctypes.c_int64(x)
                for x in given
            )
        )
    )
