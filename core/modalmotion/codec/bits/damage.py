"""Damaged streams: one error for all parts."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager

from modalmotion.errors import MalformedFileError, ModalMotionError


def damaged(message: str) -> MalformedFileError:
    """Make the error for bytes that no encoder writes."""
    return MalformedFileError(message, remedy="The stream is cut or damaged: send it again.")


@contextmanager
def parsing(message: str) -> Iterator[None]:
    """Report bytes that do not parse as damage.

    Raises
    ------
    MalformedFileError
        With this message, in place of the errors of indexing and unpacking.
    """
    try:
        yield
    except ModalMotionError:
        raise
    except (IndexError, ValueError, struct.error, zlib.error) as error:
        raise damaged(message) from error
