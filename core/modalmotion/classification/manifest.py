"""Labelled files: the rows of a table, or files in folders named by class."""

import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from modalmotion import formats, mesh
from modalmotion.classification.cases import TrainingCase
from modalmotion.errors import MalformedFileError, ModalMotionError, ParameterError, named
from modalmotion.formats.parser_process import parser_of_thread
from modalmotion.tracking.recordings import sequence_of

COLUMNS: Final = ("path", "label", "subject")
"""Of a manifest; further ones are facts and covariates."""

# What they are also called.
_ALSO: Final = {"file": "path", "class": "label", "patient": "subject"}

# As spreadsheets state the separator that their language uses.
_STATED_SEPARATOR: Final = re.compile(r"sep=(.)\r?\n")

_HOW: Final = (
    "Give a table with the columns path, label and, if known, subject and facts, in UTF-8 (Excel: "
    "CSV UTF-8); or files in folders named by their class."
)


@dataclass(frozen=True)
class LabelledFile:
    """A file with its class.

    Parameters
    ----------
    path : Path
    label : str
    subject : str or None
    facts : Facts
        Override those that the file states.
    url : str or None
        Of one that is elsewhere; the path is its name then.
    """

    path: Path
    label: str
    subject: str | None
    facts: mesh.Facts = mesh.NO_FACTS
    url: str | None = None


def labelled_files(
    sources: Sequence[Path], *, skip_unreadable: bool = False, needs_label: bool = True
) -> list[LabelledFile]:
    """List the labelled files: rows of one .csv manifest, or files by their folders.

    Parameters
    ----------
    sources : sequence of Path
    skip_unreadable : bool
        Whether a file may be missing: who reads it is told then.
    needs_label : bool
        Whether every row of a manifest must have a label.

    Raises
    ------
    MalformedFileError, ParameterError
        If a row or a file is missing, has no class, or is named twice; it says which.
    """
    if len(sources) == 1 and sources[0].suffix.lower() in (".csv", ".tsv"):
        files = read_manifest(sources[0], skip_unreadable=skip_unreadable, needs_label=needs_label)
    else:
        files = [_by_folder(path, skip_unreadable) for path in sources]
    path, n = Counter(file.path for file in files).most_common(1)[0] if files else (None, 0)
    if n > 1:
        labels = sorted({file.label for file in files if file.path == path})
        as_two = f", with the labels {' and '.join(map(repr, labels[:3]))}" if labels[1:] else ""
        raise ParameterError(
            f"'{path}' is listed {n} times{as_two}.",
            remedy="List each file once: otherwise it could be on both sides of a split.",
        )
    return files


def read_manifest(
    manifest: Path, *, skip_unreadable: bool = False, needs_label: bool = True
) -> list[LabelledFile]:
    """Read a table of files: path, label, subject; paths are relative to the table's folder.

    A column `file` is read as path, `class` as label and `patient` as subject where these are
    absent. Further columns state facts, by their names or as landmark:apex and covariate:age; all
    others are covariates.

    Raises
    ------
    MalformedFileError
        If it is not such a table, or a row lacks something; it names the line.
    """
    needed = COLUMNS[: 2 if needs_label else 1]
    return [
        _labelled(manifest, row, skip_unreadable)
        for row in manifest_rows(_text_of(manifest), manifest.name, needed)
    ]


@dataclass(frozen=True)
class Row:
    """A row of a manifest.

    Parameters
    ----------
    line : int
        Of the file, counted from 1.
    path : str
        As it is written.
    label, subject : str or None
    facts : Facts
    """

    line: int
    path: str
    label: str | None
    subject: str | None
    facts: mesh.Facts


def manifest_rows(text: str, name: str, needed: Sequence[str] = COLUMNS[:1]) -> Iterator[Row]:
    """Read a table as spreadsheets write it: columns separated by commas, semicolons or tabs.

    Parameters
    ----------
    text : str
    name : str
        Of the file, for errors.
    needed : sequence of str
        Columns in which no cell may be empty.

    Raises
    ------
    MalformedFileError
        If it is not such a table; it names the line.
    """
    text = text.removeprefix("\ufeff")
    stated = _STATED_SEPARATOR.match(text)
    line = 1 if stated else 0
    text = text[stated.end() if stated else 0 :]
    first = text.partition("\n")[0]
    # A column's name may contain one of the others.
    separator = stated[1] if stated else max(",;\t", key=first.count)
    rows = csv.reader(
        io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True, strict=True
    )
    heading: list[str] = []
    try:
        for cells in rows:
            at = line + rows.line_num
            if not heading:
                heading = _heading(cells, needed, f"Line {at} of '{name}'", at)
            # Spreadsheets write the rows below a table, and the columns beside it, as empty.
            elif any(cell.strip() for cell in cells):
                if any(cell.strip() for cell in cells[len(heading) :]):
                    raise _wrong(f"Line {at} of '{name}' has more columns than headings.", at)
                row = dict(zip(heading, cells, strict=False))
                yield _row(row, needed, separator != ",", name, at)
    except csv.Error as error:
        at = line + rows.line_num
        raise _wrong(f"Line {at} of '{name}': {error}.", at) from error
    if not heading:
        _heading([], needed, f"'{name}'", 1)


def _heading(cells: list[str], needed: Sequence[str], where: str, line: int) -> list[str]:
    given = [mesh.column_of(name) for name in cells]
    names = [name if _ALSO.get(name, name) in given else _ALSO.get(name, name) for name in given]
    if missing := [name for name in needed if name not in names]:
        found = ", ".join(map(repr, names[:5]))[:80]
        raise _wrong(f"{where} has no column '{missing[0]}', only {found or 'nothing'}.", line)
    known = (name for name in names if name in COLUMNS or mesh.states_fact(name))
    if twice := next((name for name in known if names.count(name) > 1), None):
        raise _wrong(f"{where} has two columns '{twice[:80]}'.", line)
    return names


def _row(
    cells: dict[str, str], needed: Sequence[str], decimal_comma: bool, name: str, line: int
) -> Row:
    path, label, subject = (cells.get(column, "").strip() or None for column in COLUMNS)
    for column, value in zip(needed, (path, label), strict=False):
        if not value or "\0" in value:
            raise _wrong(f"Line {line} of '{name}' has no {column}.", line)
    try:
        facts = mesh.facts_in(cells, decimal_comma=decimal_comma)
    except ParameterError as error:
        raise MalformedFileError(
            f"Line {line} of '{name}': {error.message}",
            remedy=error.remedy,
            details={**error.details, "line": line},
        ) from error
    return Row(line, path or "", label, subject, facts)


def _wrong(message: str, line: int) -> MalformedFileError:
    return MalformedFileError(message, remedy=_HOW, details={"line": line})


def _text_of(manifest: Path) -> str:
    try:
        return manifest.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeError) as error:
        raise MalformedFileError(
            f"The manifest '{manifest}' cannot be read as UTF-8 text ({error}).", remedy=_HOW
        ) from error


@dataclass(frozen=True)
class LabelledSequence:
    """A case whose sequence is in a file: a `CaseSource`.

    Parameters
    ----------
    file : LabelledFile
    stated : mapping
        Fields of `ReadOptions` for all files, which override their own statements.
    """

    file: LabelledFile
    stated: Mapping[str, Any]

    @property
    def name(self) -> str:
        """Path of the file."""
        return str(self.file.path)

    def read(self) -> TrainingCase:
        """Read the sequence.

        Raises
        ------
        ModalMotionError
            If the file cannot be used; it names the file.
        """
        file = self.file
        try:
            options = formats.ReadOptions(facts=file.facts, **self.stated)
            sequence = sequence_of(file.path, options, parser=parser_of_thread(options.limits))
        except ModalMotionError as error:
            raise named(error, str(file.path)) from error
        return TrainingCase(sequence, file.label, file.subject, name=str(file.path))


def read_cases(path: Path, *, unit: str | None = None) -> list[LabelledSequence]:
    """List the cases of a table (.csv) with the columns path, label and subject.

    Parameters
    ----------
    path : str or Path
        Paths in the table are relative to its folder; further columns are facts and covariates.
    unit : str, optional
        Length unit of all files, over their own.

    Returns
    -------
    list of LabelledSequence
        For `train` and `evaluate`; each file is read when it is needed.

    Raises
    ------
    MalformedFileError
        If it is not such a table, or a row lacks something; it names the line.
    """
    return [LabelledSequence(file, {"unit": unit}) for file in labelled_files([path])]


def _by_folder(path: Path, skip_unreadable: bool) -> LabelledFile:
    label = path.resolve().parent.name
    if tables := sorted(path.glob("*.csv")):
        raise ParameterError(f"'{path}' is a folder.", remedy=f"Name its table: '{tables[0]}'.")
    if not (path.exists() or skip_unreadable) or not label:
        raise ParameterError(f"There is no file '{path}'.", remedy=_HOW)
    return LabelledFile(path, label, None)


def _labelled(manifest: Path, row: Row, skip_unreadable: bool) -> LabelledFile:
    is_url = "://" in row.path
    path = Path(row.path.partition("?")[0]) if is_url else manifest.parent / row.path
    if not (path.exists() or skip_unreadable):
        raise MalformedFileError(
            f"Line {row.line} of '{manifest.name}' names '{row.path}', but there is no such file.",
            remedy="Paths are relative to the folder of the manifest. To continue without such "
            "files, use --skip-unreadable.",
            details={"line": row.line},
        )
    url = row.path if is_url else None
    return LabelledFile(path, row.label or "", row.subject, row.facts, url)
