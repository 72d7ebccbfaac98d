"""A folder that goes with its process, and those that killed processes left behind."""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import tempfile
from pathlib import Path
from typing import Final

_PREFIX: Final = "modalmotion-"


def temporary_folder() -> Path:
    """Make a folder that is locked while this process lives, and remove those that nobody holds."""
    parent = Path(tempfile.gettempdir())
    for left in parent.glob(f"{_PREFIX}*"):
        # Another user's, in use, or gone meanwhile.
        with contextlib.suppress(OSError), contextlib.ExitStack() as stack:
            stack.callback(os.close, _locked(left))
            shutil.rmtree(left)
    # Named when it is locked: whoever sweeps in between would take it for one that was left behind.
    made = Path(tempfile.mkdtemp(prefix=f".{_PREFIX}"))
    _locked(made)
    return made.rename(parent / made.name[1:])


def _locked(folder: Path) -> int:
    """Lock a folder until the descriptor that this gives is closed."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
