"""Forms, with one file or many in the spool, and the table that describes many."""

from __future__ import annotations

import contextlib
import csv
import io
import re
from collections.abc import AsyncIterator, Iterator
from contextlib import aclosing, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import SpooledTemporaryFile
from typing import BinaryIO, Final, cast

from starlette.datastructures import FormData, UploadFile
from starlette.exceptions import HTTPException
from starlette.formparsers import MultiPartException, MultiPartParser
from starlette.requests import Request

from modalmotion.errors import LimitError, MalformedFileError, ParameterError
from modalmotion.mesh.fact_forms import column_of, facts_in, states_fact
from modalmotion.mesh.facts import NO_FACTS, Facts
from modalmotion.store.disk import cannot_write
from modalmotion.store.folder import require_name

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

_COLUMNS: Final = ("path", "subject", "label")
# Column separators of spreadsheets, which depend on their language.
_BETWEEN: Final = ",;\t"
_STATED_SEPARATOR: Final = re.compile(r"sep=(.)\r?\n")


@dataclass(frozen=True)
class Entry:
    """What a table says of a file.

    Parameters
    ----------
    subject, label : str or None
    facts : Facts
        Over those that the file states.
    """

    subject: str | None = None
    label: str | None = None
    facts: Facts = NO_FACTS


def entries_by_name(text: str) -> dict[str, Entry]:
    """Read a table: its heading has path and, where they are known, subject, label and facts.

    Its columns are separated by commas, semicolons or tabs; further ones are covariates.

    Raises
    ------
    MalformedFileError
        If it cannot be read, or names a file twice; names the line.
    """
    text = text.removeprefix("\ufeff")
    has_commas = _separator(text) != ","
    lines: dict[str, int] = {}
    entries = {}
    for line, row in _rows(text):
        name = row.get("path", "").strip()
        if not name or "\0" in name:
            raise _wrong(line, "there is no path")
        if name in lines:
            raise _wrong(line, f"'{name}' is in line {lines[name]} already")
        lines[name] = line
        subject, label = (row.get(key, "").strip() or None for key in _COLUMNS[1:])
        try:
            require_name("subject", subject)
            require_name("label", label)
            facts = facts_in(row, decimal_comma=has_commas)
        except ParameterError as error:
            raise _wrong(line, error.message.rstrip(".")) from error
        entries[name] = Entry(subject, label, facts)
    return entries


def _rows(text: str) -> Iterator[tuple[int, dict[str, str]]]:
    stated = _STATED_SEPARATOR.match(text)
    n_before = 1 if stated else 0
    content = io.StringIO(text[stated.end() if stated else 0 :], newline="")
    rows = csv.reader(content, delimiter=_separator(text), strict=True)
    try:
        heading = [column_of(name) for name in next(rows, [])]
        if "path" not in heading:
            raise _wrong(n_before + 1, f"the heading {heading[:5]} has no column 'path'")
        known = [name for name in heading if name in _COLUMNS or states_fact(name)]
        twice = next((name for name in known if heading.count(name) > 1), None)
        if twice is not None:
            raise _wrong(n_before + 1, f"there are two columns '{twice}'")
        for cells in rows:
            line = n_before + rows.line_num
            # Spreadsheets write the rows below a table, and the columns beside it, as empty.
            if not any(cell.strip() for cell in cells):
                continue
            if any(cell.strip() for cell in cells[len(heading) :]):
                raise _wrong(line, "there are more columns than headings")
            yield line, dict(zip(heading, cells, strict=False))
    except csv.Error as error:
        raise _wrong(n_before + rows.line_num, str(error)) from error


def _separator(text: str) -> str:
    """Find the separator of the heading; a column's name may contain one of the others."""
    stated = _STATED_SEPARATOR.match(text)
    if stated:
        return stated[1]
    heading = text.partition("\n")[0]
    return max(_BETWEEN, key=lambda sign: len(heading.split(sign)))


def _wrong(line: int, what: str) -> MalformedFileError:
    return MalformedFileError(
        f"Line {line} of '{MANIFEST}': {what}.",
        remedy=f"A manifest has the columns {', '.join(_COLUMNS)} and facts; all but the first may "
        "be missing.",
        details={"line": line},
    )


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
