"""Labelled files named on the command line: a manifest, or files in folders named by class."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from modalmotion.cli.options import several
from modalmotion.cli.outputs import OutputFile
from modalmotion.errors import MalformedFileError, ModalMotionError, ParameterError
from modalmotion.facts import NO_FACTS, Facts, column_of, facts_in, states_fact

if TYPE_CHECKING:
    from modalmotion.classification import TrainingCase

_COLUMNS: Final = ("path", "label", "subject")

_HOW: Final = (
    "Give a table with the columns path, label and, where they are known, subject and facts; or "
    "files that lie in folders named by their class."
)


labelled_sources = several(
    click.argument(
        "sources",
        metavar="MANIFEST|FILES...",
        nargs=-1,
        required=True,
        type=click.Path(path_type=Path),
    ),
    click.option(
        "--skip-unreadable",
        is_flag=True,
        help="Go on without files that are missing, cannot be read or do not fit the others; the "
        "summary names them.",
    ),
)
"""MANIFEST or FILES, as `sources`, and the options of all of them."""

unit_option = click.option("--unit", help="Length unit of all files; overrides their own.")
"""Where the answer depends on the unit: features do not."""

cases_option = click.option(
    "--cases",
    "cases_file",
    type=OutputFile(".csv"),
    help="Table to write: probabilities of each case, held out (.csv).",
)
"""The table of held-out cases, as `cases_file`."""


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
    """

    path: Path
    label: str
    subject: str | None
    facts: Facts = NO_FACTS


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
            remedy="Name each file once: repeated, it would stand on both sides of a split.",
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
    """A case whose sequence lies in a file: a `CaseSource`.

    Parameters
    ----------
    file : LabelledFile
    stated : mapping
        Options of all files, which override their own statements; see `files.read`.
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
        from modalmotion.classification import TrainingCase
        from modalmotion.classification.cases import named
        from modalmotion.cli.files import read

        file = self.file
        try:
            sequence = read(file.path, is_one_of_many=True, facts=file.facts, **self.stated)
        except ModalMotionError as error:
            raise named(error, str(file.path)) from error
        return TrainingCase(sequence, file.label, file.subject, name=str(file.path))


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
                remedy=f"Fill it in, or leave the line out. {_HOW}",
                details={"line": line},
            )
    path = manifest.parent / values["path"]
    if not (path.exists() or skip_unreadable):
        raise MalformedFileError(
            f"Line {line} of '{manifest.name}' names '{values['path']}', and there is no such "
            "file.",
            remedy="Paths are relative to the folder that the manifest lies in. To go on without "
            "such files use --skip-unreadable.",
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
    return LabelledFile(path, values["label"], values["subject"] or None, facts)
