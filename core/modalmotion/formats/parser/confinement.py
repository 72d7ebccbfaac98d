"""A process that reads strangers' files sees no others: Landlock, where Linux has it.

The libraries that parse HDF5 and VTK can be made to run anything by some file. What runs in a
confined process reads Python and its packages, writes nothing, opens no connection and signals
nobody. No right is needed for it, and nothing gives it back (Linux 5.13; connections from 6.7,
signals from 6.12).
"""

from __future__ import annotations

import ctypes
import os
import signal
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

# The same numbers on every architecture.
_CREATE_RULESET: Final = 444
_ADD_RULE: Final = 445
_RESTRICT_SELF: Final = 446
_VERSION: Final = 1
_PATH_BENEATH: Final = 1
_PARENT_DEATH_SIGNAL: Final = 1
_NO_NEW_PRIVILEGES: Final = 38

# Execute, read a file, read a folder; of a file the first two.
_READ: Final = 0b1101
_READ_FILE: Final = 0b0101
# Rights over files that each version of the interface knows.
_RIGHTS: Final = {1: 13, 2: 14, 3: 15, 4: 15}
_ALL_RIGHTS: Final = 16


def landlock_version() -> int:
    """Version of Landlock's interface in this system; 0 where there is none."""
    if sys.platform != "linux":
        return 0
    return max(0, int(_libc().syscall(_CREATE_RULESET, None, 0, _VERSION)))


def confine() -> bool:
    """Leave this process nothing but Python and its packages, to read; False where that fails."""
    version = landlock_version()
    if not version:
        return False
    libc = _libc()
    handled = (1 << _RIGHTS.get(version, _ALL_RIGHTS)) - 1
    # Files; binding and connecting; sockets without a name in the file system, and signals.
    rules = struct.pack("=3Q", handled, 0b11 if version >= 4 else 0, 0b11 if version >= 6 else 0)
    ruleset = libc.syscall(
        _CREATE_RULESET, rules, 8 if version < 4 else 16 if version < 6 else 24, 0
    )
    if ruleset < 0:
        return False
    try:
        for path in _readable():
            _allow(libc, ruleset, path)
        if libc.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0):
            return False
        return bool(libc.syscall(_RESTRICT_SELF, ruleset, 0) == 0)
    finally:
        os.close(ruleset)


def end_with(parent: int) -> None:
    """Have this process killed when its parent ends, whatever it is doing (Linux).

    Parameters
    ----------
    parent : int
        Its number; where it has ended already, so does this process.
    """
    if sys.platform == "linux":
        _libc().prctl(_PARENT_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)


def _readable() -> Iterator[Path]:
    # The package itself.
    yield Path(__file__).parents[2]
    for prefix in {sys.prefix, sys.base_prefix, sys.exec_prefix}:
        for name in ("lib", "lib64", "bin"):
            yield Path(prefix) / name
    for library in ("/lib", "/lib64", "/usr/lib", "/usr/lib64", "/usr/local/lib"):
        yield Path(library)
    # Its own size, which the limit on memory starts from.
    yield Path("/proc/self")
    yield from map(Path, ("/etc/ld.so.cache", "/dev/null", "/dev/urandom"))


def _allow(libc: ctypes.CDLL, ruleset: int, path: Path) -> None:
    try:
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        rule = struct.pack("=Qi", _READ if path.is_dir() else _READ_FILE, place)
        libc.syscall(_ADD_RULE, ruleset, _PATH_BENEATH, rule, 0)
    finally:
        os.close(place)


def _libc() -> ctypes.CDLL:
    libc = ctypes.CDLL(None, use_errno=True)
    libc.syscall.restype = ctypes.c_long
    return libc
