"""Many files of one form, which lie one after the other in one file of the spool."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import BinaryIO, Final

from modalmotion.errors import LimitError

FILES: Final = "files"
"""Name of the parts of a form that are many files."""

_LONGEST_NAME: Final = 200


class SentPart:
    """One of the files; written as a part of a form is.

    Parameters
    ----------
    name : str
    file : binary file
        Written to at its end.
    """

    def __init__(self, name: str, file: BinaryIO) -> None:
        self.name = name
        self.start = 0
        self.length = 0
        self._file = file

    async def write(self, data: bytes) -> None:
        """Add bytes; pieces of some 64 KiB go to the page cache, which is worth no thread."""
        if not self.length:
            self.start = self._file.tell()
        self._file.write(data)
        self.length += len(data)

    async def seek(self, _: int) -> None:
        """Do nothing at its end: it is read elsewhere."""


class ManyFiles:
    """The file that they go to, made with the first of them.

    Parameters
    ----------
    path : Path
    most : int
        Files in it.
    """

    def __init__(self, path: Path, most: int) -> None:
        self.path = path
        self.parts: list[SentPart] = []
        self.most = most
        self._file: BinaryIO | None = None

    def add(self, name: str) -> SentPart:
        """Begin a file.

        Parameters
        ----------
        name : str
            As its sender calls it; may be empty.

        Raises
        ------
        LimitError
            If it is one too many.
        """
        if len(self.parts) == self.most:
            raise LimitError(
                f"The form has more than {self.most} files.",
                remedy="Send them in several requests.",
                limit="batch_files",
                details={"most": self.most},
            )
        if self._file is None:
            self._file = self.path.open("xb")
        part = SentPart(name[:_LONGEST_NAME] or f"file {len(self.parts) + 1}", self._file)
        self.parts.append(part)
        return part

    def close(self) -> None:
        """Write what is left; it may fail as any write."""
        if self._file is not None:
            self._file.close()

    def discard(self) -> None:
        """Remove the file, as far as it can be."""
        with contextlib.suppress(OSError):
            self.close()
        with contextlib.suppress(OSError):
            self.path.unlink(missing_ok=True)
