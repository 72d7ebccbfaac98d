"""Labelled files: the rows of a table, or files in folders named by class."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from modalmotion.classification.cases import TrainingCase, named
from modalmotion.errors import MalformedFileError, ModalMotionError, ParameterError
from modalmotion.formats import ReadOptions
from modalmotion.mesh import NO_FACTS, Facts, column_of, facts_in, states_fact
from modalmotion.tracking.parameters import sequence_of

_COLUMNS: Final = ("path", "label", "subject")

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
        files = [_by_folder(path, skip_unreadable) for path in sources]
    path, n = Counter(file.path for file in files).most_common(1)[0] if files else (None, 0)
    if n > 1:
        labels = sorted({file.label for file in files if file.path == path})
        as_two = f", with the labels {' and '.join(map(repr, labels[:3]))}" if labels[1:] else ""
        raise ParameterError(
            f"'{path}' is named {n} times{as_two}.",
            remedy="Name each file once: repeated, it would be on both sides of a split.",
        )
    return files


def read_manifest(
    manifest: Path, *, skip_unreadable: bool = False, needs_label: bool = True
) -> list[LabelledFile]:
    """Read a table of files: path, label, subject; paths are relative to the table's folder.

    Further columns state facts, by their names or as landmark:apex and covariate:age; all others
    are covariates.

    Raises
    ------
    MalformedFileError
        If it is not such a table, or a row lacks something; it names the line.
    """
    text = _text_of(manifest)
    lines = text.splitlines()
    first = lines[0] if lines else ""
    delimiter = max(",;\t", key=first.count)
    rows = csv.DictReader(lines, delimiter=delimiter, skipinitialspace=True)
    names = [column_of(name or "") for name in rows.fieldnames or []]
    needed = _COLUMNS[: 2 if needs_label else 1]
    missing = [name for name in needed if name not in names]
    if missing:
        raise MalformedFileError(
            f"The manifest '{manifest}' has no column {' and no column '.join(missing)}; its "
            f"first line is {first[:80]!r}.",
            remedy=_HOW,
        )
    twice = [name for name, n in Counter(names).items() if n > 1 and states_fact(name)]
    if twice:
        raise MalformedFileError(
            f"The manifest '{manifest}' has {names.count(twice[0])} columns '{twice[0][:80]}'.",
            remedy="Keep one of them.",
        )
    rows.fieldnames = names
    has_commas = delimiter != ","
    settings = needed, has_commas, skip_unreadable
    return [_row(manifest, rows.line_num, row, *settings) for row in rows]


def _text_of(manifest: Path) -> str:
    try:
        text = manifest.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise MalformedFileError(
            f"The manifest '{manifest}' cannot be read as text ({error}).", remedy=_HOW
        ) from error
    except UnicodeDecodeError as error:
        raise _not_utf8(manifest, error.start) from error
    # UTF-16 without a mark at its beginning.
    if "\0" in text:
        raise _not_utf8(manifest, text.index("\0"))
    return text


def _not_utf8(manifest: Path, place: int) -> MalformedFileError:
    return MalformedFileError(
        f"The manifest '{manifest}' is not UTF-8 text (byte {place}).",
        remedy="Save the table as UTF-8 (in Excel: CSV UTF-8).",
    )


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


def _by_folder(path: Path, skip_unreadable: bool) -> LabelledFile:
    label = path.resolve().parent.name
    if not (path.exists() or skip_unreadable) or not label:
        raise ParameterError(f"There is no file '{path}'.", remedy=_HOW)
    return LabelledFile(path, label, None)


def _row(
    manifest: Path,
    line: int,
    row: dict[str, Any],
    needed: Sequence[str],
    decimal_comma: bool,
    skip_unreadable: bool,
) -> LabelledFile:
    values = {name: (row.get(name) or "").strip() for name in _COLUMNS}
    for name in needed:
        if not values[name]:
            raise MalformedFileError(
                f"Line {line} of '{manifest.name}' has no {name}.",
                remedy=f"Fill it in, or remove the line. {_HOW}",
                details={"line": line},
            )
    url = values["path"] if "://" in values["path"] else None
    path = Path(values["path"].partition("?")[0]) if url else manifest.parent / values["path"]
    if not (path.exists() or skip_unreadable):
        raise MalformedFileError(
            f"Line {line} of '{manifest.name}' names '{values['path']}', and there is no such "
            "file.",
            remedy="Paths are relative to the folder of the manifest. To continue without such "
            "files use --skip-unreadable.",
            details={"line": line},
        )
    try:
        facts = facts_in(row, decimal_comma=decimal_comma)
    except ParameterError as error:
        raise MalformedFileError(
            f"Line {line} of '{manifest.name}': {error.message}",
            remedy=error.remedy,
            details={**error.details, "line": line},
        ) from error
    return LabelledFile(path, values["label"], values["subject"] or None, facts, url)
