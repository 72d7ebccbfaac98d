"""Faults of the disk, of memory or of descriptors: none of the doing of whoever meets them."""

from __future__ import annotations

import errno
from typing import Final

_OF_THE_MACHINE: Final = frozenset(
    {
        *(errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EIO),
        *(errno.ESTALE, errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ENODEV),
    }
)


def is_of_the_machine(error: BaseException) -> bool:
    """Tell whether the same could succeed at another time, with nothing else changed."""
    return isinstance(error, OSError) and error.errno in _OF_THE_MACHINE
