"""Which files a cohort consists of."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from modalmotion.errors import MalformedFileError
from modalmotion.store.record import require_name

_COLUMNS: Final = ("path", "subject", "label")
_WILD: Final = frozenset("*?[")

# Tables, texts and pictures lie beside sequences: simulate-cohort writes its table so.
_NO_SEQUENCES: Final = frozenset(
    {".csv", ".jsonl", ".json", ".txt", ".md", ".png", ".svg", ".pdf", ".log"}
)


@dataclass(frozen=True)
class Entry:
    """One sequence of a cohort.

    Parameters
    ----------
    path : Path
        Absolute; a file, a folder of frames, or a pattern of their names.
    subject, label : str or None
    """

    path: Path
    subject: str | None = None
    label: str | None = None


def read_manifest(source: Path) -> tuple[Entry, ...]:
    """List the sequences that a manifest, a folder or a pattern names.

    Parameters
    ----------
    source : Path
        A .csv file with a heading (path, and subject and label if there are any), or a .jsonl
        file with an object a line, both with paths from the manifest's own folder; or a
        folder, or a pattern of names: then each file and each folder of frames in it is a
        sequence.

    Raises
    ------
    MalformedFileError
        If it cannot be read, names a sequence twice, or names none; the line is told.
    """
    if source.is_dir():
        entries = _listed(path for path in source.iterdir() if path.suffix not in _NO_SEQUENCES)
    elif source.suffix in (".csv", ".jsonl") and not _WILD & set(source.name):
        entries = _read(source)
    elif _WILD & set(source.name):
        entries = _listed(source.parent.glob(source.name))
    else:
        raise MalformedFileError(
            f"'{source.name}' is no manifest, folder or pattern.",
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


def _read(source: Path) -> tuple[Entry, ...]:
    try:
        text = source.read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise MalformedFileError(
            f"The manifest '{source.name}' cannot be read: {error}.",
            remedy="Write it as UTF-8 text.",
        ) from error
    rows = _csv_rows(text, source) if source.suffix == ".csv" else _json_rows(text, source)
    lines: dict[Path, int] = {}
    entries = []
    for line, row in rows:
        name = row.get("path")
        if not isinstance(name, str) or not name.strip() or "\0" in name:
            raise _wrong(source, line, "there is no path")
        path = (source.absolute().parent / name.strip()).absolute()
        if path in lines:
            raise _wrong(source, line, f"'{name}' stands in line {lines[path]} already")
        lines[path] = line
        names = {key: _name(row.get(key), key, source, line) for key in ("subject", "label")}
        entries.append(Entry(path, **names))
    return tuple(entries)


def _csv_rows(text: str, source: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    reader = csv.DictReader(io.StringIO(text, newline=""), strict=True)
    try:
        heading = [name.strip() for name in reader.fieldnames or ()]
        if "path" not in heading:
            raise _wrong(source, 1, f"the heading {heading[:5]} has no column 'path'")
        reader.fieldnames = heading
        for row in reader:
            if None in row:
                raise _wrong(source, reader.line_num, "there are more columns than headings")
            yield reader.line_num, row
    except csv.Error as error:
        raise _wrong(source, reader.line_num, str(error)) from error


def _json_rows(text: str, source: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    for line, content in enumerate(text.splitlines(), start=1):
        if not content.strip():
            continue
        try:
            row = json.loads(content)
        except ValueError as error:
            raise _wrong(source, line, str(error)) from error
        if not isinstance(row, dict):
            raise _wrong(source, line, "that is no object")
        yield line, row


def _name(value: Any, key: str, source: Path, line: int) -> str | None:
    text = None if value is None else str(value).strip()
    try:
        require_name(key, text or None)
    except ValueError as error:
        raise _wrong(source, line, str(error)) from error
    return text or None


def _wrong(source: Path, line: int, what: str) -> MalformedFileError:
    return MalformedFileError(
        f"Line {line} of '{source.name}': {what}.",
        remedy=f"A manifest has the columns {', '.join(_COLUMNS)}; the last two may be missing.",
        details={"line": line},
    )
