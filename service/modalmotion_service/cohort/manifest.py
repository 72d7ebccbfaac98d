"""Which files a cohort consists of."""

from __future__ import annotations

import csv
import io
import json
import re
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final

from modalmotion.errors import MalformedFileError, ParameterError
from modalmotion.facts import NO_FACTS, Facts, column_of, facts_in, states_fact
from modalmotion.store.record import require_name
from modalmotion_service.cohort.remote import RemoteFile, Source, is_url, source_of
from modalmotion_service.cohort.remote_systems import listed
from modalmotion_service.cohort.transfer import fetched

_COLUMNS: Final = ("path", "subject", "label")
_WILD: Final = frozenset("*?[")
_SUFFIXES: Final = (".csv", ".jsonl")
# Column separators of spreadsheets, which depend on their language.
_BETWEEN: Final = ",;\t"
_STATED_SEPARATOR: Final = re.compile(r"sep=(.)\r?\n")

# Tables, texts and pictures lie beside sequences: simulate-cohort writes its table so.
_NO_SEQUENCES: Final = frozenset(
    {".csv", ".jsonl", ".json", ".txt", ".md", ".png", ".svg", ".pdf", ".log"}
)


@dataclass(frozen=True)
class Entry:
    """One sequence of a cohort.

    Parameters
    ----------
    path : Path or RemoteFile
        A file, a folder of frames, or a pattern of their names; of this machine it is absolute.
    subject, label : str or None
    facts : Facts
        Over those that the file states.
    """

    path: Source
    subject: str | None = None
    label: str | None = None
    facts: Facts = NO_FACTS


def read_manifest(source: Source, most_bytes: int = 256_000_000) -> tuple[Entry, ...]:
    """List the sequences that a manifest, a folder or a pattern names.

    Parameters
    ----------
    source : Path or RemoteFile
        A .csv file with a heading (path; subject, label and facts if there are any; further ones
        are covariates), its columns separated by commas, semicolons or tabs, or a .jsonl file
        with an object a line, both with paths from the manifest's own folder; or a folder, or a
        pattern of names: then each file and each folder of frames in it is a sequence. All of them
        may lie elsewhere, and rows of a manifest may be URLs.
    most_bytes : int
        Of a manifest that lies elsewhere.

    Raises
    ------
    MalformedFileError
        If it cannot be read, names a sequence twice, or names none; names the line.
    """
    if isinstance(source, RemoteFile):
        entries = _elsewhere(source, most_bytes)
    elif source.is_dir():
        entries = _listed(
            path for path in source.iterdir() if path.suffix.lower() not in _NO_SEQUENCES
        )
    elif source.suffix.lower() in _SUFFIXES and not _WILD & set(source.name):
        entries = _read(source)
    elif _WILD & set(source.name):
        entries = _listed(source.parent.glob(source.name))
    else:
        raise MalformedFileError(
            f"'{source.name}' is not a manifest, a folder or a pattern.",
            remedy="Name a .csv or .jsonl manifest, a folder of sequences, or a pattern such "
            "as 'scans/*.npz'.",
        )
    if not entries:
        raise MalformedFileError(
            f"'{source.name}' names no sequence.", remedy="Check the folder or the manifest."
        )
    return entries


def _listed(paths: Iterator[Path]) -> tuple[Entry, ...]:
    return tuple(Entry(path.absolute()) for path in sorted(paths) if path.name[0] != ".")


def _elsewhere(source: RemoteFile, most_bytes: int) -> tuple[Entry, ...]:
    suffix = PurePosixPath(source.name).suffix.lower()
    if suffix in _SUFFIXES and not source.is_pattern:
        with (
            tempfile.TemporaryDirectory() as folder,
            fetched(source, Path(folder), most_bytes) as copy,
        ):
            return _read(copy, source)
    return tuple(
        Entry(file)
        for file in listed(source)
        if PurePosixPath(file.name).suffix.lower() not in _NO_SEQUENCES and file.name[:1] != "."
    )


def entries_by_name(table: str, name: str) -> dict[str, Entry]:
    """List what a table says of files that were sent with it, by their names.

    Parameters
    ----------
    table : str
        As a .csv manifest.
    name : str
        What errors call it.

    Raises
    ------
    MalformedFileError
        If it cannot be read, or names a file twice; names the line.
    """
    # Names of files that lie nowhere yet.
    root = Path("/")
    entries = _entries(table, root / name, lambda row: (root / row).absolute(), is_table=True)
    return {Path(str(entry.path)).relative_to(root).as_posix(): entry for entry in entries}


def _read(source: Path, origin: RemoteFile | None = None) -> tuple[Entry, ...]:
    try:
        text = source.read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise _unreadable(source, error) from error
    is_table = source.suffix.lower() == ".csv"

    def locate(name: str) -> Source:
        if is_url(name):
            return source_of(name)
        return origin.beside(name) if origin else (source.absolute().parent / name).absolute()

    return _entries(text, source, locate, is_table=is_table)


def _entries(
    text: str, source: Path, locate: Callable[[str], Source], *, is_table: bool
) -> tuple[Entry, ...]:
    rows = _csv_rows(text, source) if is_table else _json_rows(text, source)
    has_commas = is_table and _separator(text) != ","
    lines: dict[Source, int] = {}
    entries = []
    for line, row in rows:
        name = row.get("path")
        if not isinstance(name, str) or not name.strip() or "\0" in name:
            raise _wrong(source, line, "there is no path")
        try:
            path = locate(name.strip())
        except ParameterError as error:
            raise _wrong(source, line, error.message.rstrip(".")) from error
        if path in lines:
            raise _wrong(source, line, f"'{name}' stands in line {lines[path]} already")
        lines[path] = line
        names = {key: _name(row.get(key), key, source, line) for key in ("subject", "label")}
        facts = _facts(row, source, line, decimal_comma=has_commas)
        entries.append(Entry(path, **names, facts=facts))
    return tuple(entries)


def _csv_rows(text: str, source: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    stated = _STATED_SEPARATOR.match(text)
    first = stated.end() if stated else 0
    content = io.StringIO(text[first:], newline="")
    rows = csv.reader(content, delimiter=_separator(text), strict=True)
    n_before = 1 if stated else 0
    try:
        heading = [column_of(name) for name in next(rows, [])]
        if "path" not in heading:
            raise _wrong(source, n_before + 1, f"the heading {heading[:5]} has no column 'path'")
        known = [name for name in heading if name in _COLUMNS or states_fact(name)]
        twice = next((name for name in known if heading.count(name) > 1), None)
        if twice is not None:
            raise _wrong(source, n_before + 1, f"there are two columns '{twice}'")
        for cells in rows:
            line = n_before + rows.line_num
            # Spreadsheets write the rows below a table, and the columns beside it, as empty.
            if not any(cell.strip() for cell in cells):
                continue
            if any(cell.strip() for cell in cells[len(heading) :]):
                raise _wrong(source, line, "there are more columns than headings")
            yield line, dict(zip(heading, cells, strict=False))
    except csv.Error as error:
        raise _wrong(source, n_before + rows.line_num, str(error)) from error


def _separator(text: str) -> str:
    """Find the separator of the heading; a column's name may hold one of the others."""
    stated = _STATED_SEPARATOR.match(text)
    if stated:
        return stated[1]
    heading = text.partition("\n")[0]
    return max(_BETWEEN, key=lambda sign: len(heading.split(sign)))


def _json_rows(text: str, source: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    for line, content in enumerate(text.splitlines(), start=1):
        if not content.strip():
            continue
        try:
            row = json.loads(content)
        except ValueError as error:
            raise _wrong(source, line, str(error)) from error
        if not isinstance(row, dict):
            raise _wrong(source, line, "this is not an object")
        yield line, row


def _name(value: Any, key: str, source: Path, line: int) -> str | None:
    text = None if value is None else str(value).strip()
    try:
        require_name(key, text or None)
    except ValueError as error:
        raise _wrong(source, line, str(error).rstrip(".")) from error
    return text or None


def _facts(row: dict[str, Any], source: Path, line: int, *, decimal_comma: bool) -> Facts:
    try:
        return facts_in(row, decimal_comma=decimal_comma)
    except ParameterError as error:
        raise _wrong(source, line, error.message.rstrip(".")) from error


def _unreadable(source: Path, error: OSError | UnicodeDecodeError) -> MalformedFileError:
    if isinstance(error, OSError):
        return MalformedFileError(
            f"The manifest '{source.name}' cannot be read: {error.strerror}.",
            remedy="Check its name, and that this user may read it.",
        )
    return MalformedFileError(
        f"The manifest '{source.name}' is not UTF-8 text (byte {error.start}).",
        remedy="Save it as UTF-8; spreadsheets call that 'CSV UTF-8'.",
    )


def _wrong(source: Path, line: int, what: str) -> MalformedFileError:
    return MalformedFileError(
        f"Line {line} of '{source.name}': {what}.",
        remedy=f"A manifest has the columns {', '.join(_COLUMNS)} and facts; all but the first may "
        "be missing.",
        details={"line": line},
    )
