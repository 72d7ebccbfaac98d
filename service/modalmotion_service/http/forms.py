"""A form as a browser sends it, with its file in the spool.

Temporary files of the machine may lie in memory, as a container's do, or on a small disk.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import aclosing, asynccontextmanager
from pathlib import Path
from tempfile import SpooledTemporaryFile
from typing import BinaryIO, cast

from starlette.datastructures import FormData, UploadFile
from starlette.exceptions import HTTPException
from starlette.formparsers import MultiPartException, MultiPartParser
from starlette.requests import Request

from modalmotion.store.disk.atomic import cannot_write
from modalmotion_service.http.many_files import FILES, ManyFiles

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
        Where the file lies meanwhile.
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
