"""Forms, whose files go to one file of the spool as they come."""

import contextlib
from collections.abc import AsyncIterator
from contextlib import aclosing, asynccontextmanager
from pathlib import Path
from typing import BinaryIO, Final, cast

from starlette.datastructures import FormData, UploadFile
from starlette.exceptions import HTTPException
from starlette.formparsers import MultiPartException, MultiPartParser
from starlette.requests import Request

from modalmotion.errors import LimitError
from modalmotion.store.disk import cannot_write

FILES: Final = "files"
"""Name of the parts of a form that are many files."""
MANIFEST: Final = "manifest"
"""Name of the part that describes them, a field or a file."""

_LONGEST_NAME: Final = 200
_MOST_FIELDS: Final = 20


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


class FormFiles:
    """The file that they go to, made with the first of them.

    Parameters
    ----------
    path : Path
    most : int
        Parts named `FILES`; 0 where these are not taken.
    """

    def __init__(self, path: Path, most: int = 0) -> None:
        self.path = path
        self.most = most
        self.many: list[SentPart] = []
        self._file: BinaryIO | None = None

    def add(self, field: str, name: str) -> SentPart:
        """Begin a file.

        Parameters
        ----------
        field : str
            Name of its part.
        name : str
            As its sender calls it; may be empty.

        Raises
        ------
        LimitError
            If it is one too many.
        """
        is_of_many = field == FILES and self.most > 0
        if is_of_many and len(self.many) == self.most:
            raise LimitError(
                f"The form has more than {self.most} files.",
                remedy="Send them in several requests.",
                limit="batch_files",
                details={"most": self.most},
            )
        if self._file is None:
            self._file = self.path.open("xb")
        part = SentPart(name[:_LONGEST_NAME] or f"file {len(self.many) + 1}", self._file)
        if is_of_many:
            self.many.append(part)
        return part

    def read(self, part: SentPart, most: int) -> bytes:
        """Give the bytes of a part, or the first of them."""
        with self.path.open("rb") as file:
            file.seek(part.start)
            return file.read(min(part.length, most))

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


class _SpoolingParser(MultiPartParser):
    """Puts files into the spool.

    Parameters
    ----------
    request : Request
    stream : async generator of bytes
    files : FormFiles
    """

    def __init__(self, request: Request, stream: object, files: FormFiles) -> None:
        # One, or many and one that describes them.
        most = files.most + 1
        super().__init__(request.headers, stream, max_files=most, max_fields=_MOST_FIELDS)  # type: ignore[arg-type]
        self._files = files

    def on_part_data(self, data: bytes, start: int, end: int) -> None:
        waiting = self._file_parts_to_write
        if self._current_part.file is None:
            super().on_part_data(data, start, end)
        elif not waiting or waiting[-1][0] is not self._current_part:
            waiting.append((self._current_part, cast("bytes", bytearray(data[start:end]))))
        else:
            # Each line that could be the end of the part comes by itself: they are joined, up to
            # the 64 KiB that came.
            cast("bytearray", waiting[-1][1]).extend(memoryview(data)[start:end])

    def on_headers_finished(self) -> None:
        super().on_headers_finished()
        part = self._current_part
        if part.file is not None:
            part.file.file.close()
            sent = self._files.add(part.field_name, part.file.filename or "")
            part.file = cast("UploadFile", sent)


@asynccontextmanager
async def received_form(request: Request, files: FormFiles) -> AsyncIterator[FormData]:
    """Receive a form, whose files are parts of it; they are removed if anything fails.

    Parameters
    ----------
    request : Request
    files : FormFiles

    Raises
    ------
    LimitError
        If there are too many of them.
    HTTPException
        If it is not a form.
    StoreError
        If a file cannot be written.
    """
    try:
        try:
            async with aclosing(request.stream()) as stream:
                form = await _SpoolingParser(request, stream, files).parse()
            files.close()
        except MultiPartException as error:
            raise HTTPException(status_code=400, detail=error.message) from error
        except OSError as error:
            raise cannot_write(files.path.parent, error) from error
        yield form
    except BaseException:
        files.discard()
        raise
