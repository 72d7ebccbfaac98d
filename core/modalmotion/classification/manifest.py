"""Labelled files: the rows of a table, or files in folders named by class."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from modalmotion.classification.cases import TrainingCase, named
from modalmotion.errors import MalformedFileError, ModalMotionError, ParameterError
from modalmotion.formats import ReadOptions
from modalmotion.mesh import NO_FACTS, Facts, column_of, facts_in, states_fact
from modalmotion.tracking.recording import sequence_of

COLUMNS: Final = ("path", "label", "subject")

_HOW: Final = (
    "Give a table with the columns path, label and, if known, subject and facts; or files in "
    "folders named by their class."
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
    facts: Facts = NO_FACTS
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
        files = [LabelledFile(path, path.resolve().parent.name, None) for path in sources]
        for file in files:
            if not (file.path.exists() or skip_unreadable) or not file.label:
                raise ParameterError(f"There is no file '{file.path}'.", remedy=_HOW)
    path, n = Counter(file.path for file in files).most_common(1)[0] if files else (None, 0)
    if n > 1:
        labels = sorted({file.label for file in files if file.path == path})
        as_two = f", with the labels {' and '.join(map(repr, labels[:3]))}" if labels[1:] else ""
        raise ParameterError(
            f"'{path}' is named {n} times{as_two}.",
            remedy="Name each file once: repeated, it would be on both sides of a split.",
        )
    return files


class ManifestRow(NamedTuple):
    """A row of a manifest: the number of its line, and what it states of a file."""

    line: int
    path: str
    label: str
    subject: str | None
    facts: Facts


def manifest_rows(text: str, name: str, needed: Sequence[str]) -> Iterator[ManifestRow]:
    """Read the rows of a table of files, with the columns path, label and subject.

    Columns are separated by commas, semicolons or tabs. Further ones state facts, by their names or
    as landmark:apex and covariate:age; all others are covariates. Empty rows are passed over.

    Parameters
    ----------
    text : str
    name : str
        Of the table, for errors.
    needed : sequence of str
        Columns that every row must fill in.

    Raises
    ------
    MalformedFileError
        If it is not such a table, or a row lacks something; it names the line.
    """
    lines = text.removeprefix("\ufeff").splitlines()
    # What spreadsheets write before the heading, to name their separator.
    stated = lines[0][4:] if lines and re.fullmatch("sep=.", lines[0]) else ""
    heading = "".join(lines[bool(stated) : bool(stated) + 1])
    separator = stated or max(",;\t", key=heading.count)
    rows = csv.reader(lines[bool(stated) :], delimiter=separator, skipinitialspace=True)
    names, line = [column_of(column) for column in next(rows, [])], 1

    def wrong(what: str) -> MalformedFileError:
        return MalformedFileError(
            f"Line {line} of '{name}': {what}.", remedy=_HOW, details={"line": line}
        )

    for column in needed:
        if column not in names:
            raise wrong(f"the heading {heading[:80]!r} has no column '{column}'")
    for column, n in Counter(names).items():
        if n > 1 and (column in COLUMNS or states_fact(column)):
            raise wrong(f"there are {n} columns '{column[:80]}'")
    for cells in rows:
        line = rows.line_num + bool(stated)
        if not any(cell.strip() for cell in cells):
            continue
        if any(cell.strip() for cell in cells[len(names) :]):
            raise wrong("there are more columns than headings")
        row = {column: cell.strip() for column, cell in zip(names, cells, strict=False)}
        path, label, subject = (row.get(column, "") for column in COLUMNS)
        for column in needed:
            if not row.get(column):
                raise wrong(f"there is no {column}")
        try:
            facts = facts_in(row, decimal_comma=separator != ",")
        except ParameterError as error:
            raise wrong(error.message.rstrip(".")) from error
        yield ManifestRow(line, path, label, subject or None, facts)


def read_manifest(
    manifest: Path, *, skip_unreadable: bool = False, needs_label: bool = True
) -> list[LabelledFile]:
    """Read a table of files, whose paths are relative to its folder: see `manifest_rows`.

    Raises
    ------
    MalformedFileError
        If it is not such a table, or a row lacks something; it names the line.
    """
    try:
        text, reason = manifest.read_bytes().decode(), "it contains bytes of zero"
    except (OSError, UnicodeDecodeError) as error:
        text, reason = "\0", str(error)
    if "\0" in text:
        raise MalformedFileError(
            f"The manifest '{manifest}' cannot be read as UTF-8 text ({reason}).",
            remedy=f"Save the table as UTF-8 (in Excel: CSV UTF-8). {_HOW}",
        )
    files = []
    for row in manifest_rows(text, manifest.name, COLUMNS[: 2 if needs_label else 1]):
        is_url = "://" in row.path
        path = Path(row.path.partition("?")[0]) if is_url else manifest.parent / row.path
        if not (path.exists() or skip_unreadable):
            raise MalformedFileError(
                f"Line {row.line} of '{manifest.name}' names '{row.path}', and there is no such "
                "file.",
                remedy="Paths are relative to the folder of the manifest. To continue without such "
                "files use --skip-unreadable.",
                details={"line": row.line},
            )
        url = row.path if is_url else None
        files.append(LabelledFile(path, row.label, row.subject, row.facts, url))
    return files


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
            sequence = sequence_of(file.path, ReadOptions(facts=file.facts, **self.stated))
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
