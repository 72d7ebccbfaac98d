"""Forms, with one file or many in the spool."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator
from contextlib import aclosing, asynccontextmanager
from pathlib import Path
from tempfile import SpooledTemporaryFile
from typing import BinaryIO, Final, cast

from starlette.datastructures import FormData, UploadFile
from starlette.exceptions import HTTPException
from starlette.formparsers import MultiPartException, MultiPartParser
from starlette.requests import Request

from modalmotion.errors import LimitError
from modalmotion.store.disk import cannot_write

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


MANIFEST: Final = "manifest"
"""Name of the part that holds it, a field or a file."""

_MOST_FIELDS = 20


class _SpoolingParser(MultiPartParser):
    """Puts files into a folder of ours.

    Parameters
    ----------
    request : Request
    stream : async generator of bytes
    folder : Path
    many : ManyFiles, optional
        Where those go that are named as many are.
    """

    def __init__(
        self, request: Request, stream: object, folder: Path, many: ManyFiles | None
    ) -> None:
        # Beside many may stand one that describes them.
        most = 1 if many is None else many.most + 1
        super().__init__(request.headers, stream, max_files=most, max_fields=_MOST_FIELDS)  # type: ignore[arg-type]
        self._folder = folder
        self._many = many

    def on_part_data(self, data: bytes, start: int, end: int) -> None:
        waiting = self._file_parts_to_write
        if self._current_part.file is None:
            super().on_part_data(data, start, end)
        elif not waiting or waiting[-1][0] is not self._current_part:
            waiting.append((self._current_part, cast("bytes", bytearray(data[start:end]))))
        else:
            # Each line that could be the end of the part comes by itself, and each piece that is
            # written is a switch of threads: they are joined, up to the 64 KiB that came.
            cast("bytearray", waiting[-1][1]).extend(memoryview(data)[start:end])

    def on_headers_finished(self) -> None:
        super().on_headers_finished()
        part = self._current_part.file
        if part is not None:
            part.file.close()
            if self._many is not None and self._current_part.field_name == FILES:
                self._current_part.file = cast("UploadFile", self._many.add(part.filename or ""))
                return
            # It has no name there: it goes with the process, however that ends.
            file = SpooledTemporaryFile(max_size=self.spool_max_size, dir=str(self._folder))  # noqa: SIM115
            self._files_to_close_on_error.append(file)
            part.file = cast("BinaryIO", file)


@asynccontextmanager
async def received_form(
    request: Request, folder: Path, many: ManyFiles | None = None
) -> AsyncIterator[FormData]:
    """Receive a form of at most one file and close it in the end.

    Parameters
    ----------
    request : Request
    folder : Path
        Where the file is meanwhile.
    many : ManyFiles, optional
        Where files go that are named as many are; they are parts of the form too.

    Raises
    ------
    LimitError
        If there are too many of them.
    HTTPException
        If it is not a form.
    StoreError
        If the file cannot be written.
    """
    try:
        async with aclosing(request.stream()) as stream:
            form = await _SpoolingParser(request, stream, folder, many).parse()
        if many is not None:
            many.close()
    except MultiPartException as error:
        raise HTTPException(status_code=400, detail=error.message) from error
    except OSError as error:
        raise cannot_write(folder, error) from error
    try:
        yield form
    finally:
        await form.close()
