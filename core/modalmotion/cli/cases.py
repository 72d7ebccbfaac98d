"""Labelled files named on the command line: a manifest, or files in folders named by class."""

from __future__ import annotations

import csv
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from modalmotion.errors import InputError, MalformedFileError, ModalMotionError, ParameterError

if TYPE_CHECKING:
    from modalmotion.classification import TrainingCase
    from modalmotion.signature.making import SignatureParameters

_COLUMNS: Final = ("path", "label", "subject")

_HOW: Final = (
    "Give a table with the columns path, label and, where it is known, subject; or files that "
    "lie in folders named by their class."
)


@dataclass(frozen=True)
class LabelledFile:
    """A file with its class.

    Parameters
    ----------
    path : Path
    label : str
    subject : str or None
    """

    path: Path
    label: str
    subject: str | None


def labelled_files(sources: Sequence[Path]) -> list[LabelledFile]:
    """Find what is named: the rows of one .csv manifest, or files by the folders they lie in.

    Raises
    ------
    MalformedFileError, ParameterError
        If a row or a file is missing, has no class, or is named twice; it says which.
    """
    if len(sources) == 1 and sources[0].suffix.lower() in (".csv", ".tsv"):
        files = read_manifest(sources[0])
    else:
        files = [_by_folder(path) for path in sources]
    path, n = Counter(file.path for file in files).most_common(1)[0] if files else (None, 0)
    if n > 1:
        raise ParameterError(
            f"'{path}' is named {n} times.",
            remedy="Name each file once: repeated, it would stand on both sides of a split.",
        )
    return files


def read_manifest(manifest: Path) -> list[LabelledFile]:
    """Read a table of files: path, label, subject; paths are relative to the table's folder.

    Raises
    ------
    MalformedFileError
        If it is not such a table, or a row lacks something; it names the line.
    """
    try:
        text = manifest.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise MalformedFileError(
            f"The manifest '{manifest}' cannot be read as text ({error}).", remedy=_HOW
        ) from error
    lines = text.splitlines()
    first = lines[0] if lines else ""
    delimiter = max(",;\t", key=first.count)
    rows = csv.DictReader(lines, delimiter=delimiter, skipinitialspace=True)
    names = [(name or "").strip().lower() for name in rows.fieldnames or []]
    missing = [name for name in _COLUMNS[:2] if name not in names]
    if missing:
        raise MalformedFileError(
            f"The manifest '{manifest}' has no column {' and no column '.join(missing)}; its "
            f"first line is {first[:80]!r}.",
            remedy=_HOW,
        )
    rows.fieldnames = names
    return [_row(manifest, rows.line_num, row) for row in rows]


def training_cases(
    files: Sequence[LabelledFile], parameters: SignatureParameters, stated: dict[str, Any]
) -> Iterator[TrainingCase]:
    """Read and fit files one by one, with a bar.

    Parameters
    ----------
    files : sequence of LabelledFile
    parameters : SignatureParameters
    stated : dict
        Of all files, over what they say themselves; see `files.read`.

    Raises
    ------
    InputError
        If a file cannot be used; it names the file.
    """
    from modalmotion.classification import TrainingCase
    from modalmotion.cli.files import read
    from modalmotion.signature.making import modal_signature

    with click.progressbar(files, label="signatures", file=sys.stderr) as bar:
        for file in bar:
            try:
                signature = modal_signature(read(file.path, quiet=True, **stated), parameters)
                yield TrainingCase(signature, file.label, file.subject)
            except ModalMotionError as error:
                raise _of_file(error, file.path) from error


def _by_folder(path: Path) -> LabelledFile:
    label = path.resolve().parent.name
    if not path.exists() or not label:
        raise ParameterError(f"There is no file '{path}'.", remedy=_HOW)
    return LabelledFile(path, label, None)


def _row(manifest: Path, line: int, row: dict[str, Any]) -> LabelledFile:
    values = {name: (row.get(name) or "").strip() for name in _COLUMNS}
    for name in _COLUMNS[:2]:
        if not values[name]:
            raise MalformedFileError(
                f"Line {line} of '{manifest.name}' has no {name}.",
                remedy=f"Fill it in, or leave the line out. {_HOW}",
                details={"line": line},
            )
    path = manifest.parent / values["path"]
    if not path.exists():
        raise MalformedFileError(
            f"Line {line} of '{manifest.name}' names '{values['path']}', and there is no such "
            "file.",
            remedy="Paths are relative to the folder that the manifest lies in.",
            details={"line": line},
        )
    return LabelledFile(path, values["label"], values["subject"] or None)


def _of_file(error: ModalMotionError, path: Path) -> InputError:
    return InputError(f"{path}: {error.message}", remedy=error.remedy, details=error.details)
