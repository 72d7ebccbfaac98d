"""The table that describes the files of a form: names, subjects, labels, facts."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from modalmotion.errors import MalformedFileError, ParameterError
from modalmotion.mesh import NO_FACTS, Facts, column_of, facts_in, states_fact
from modalmotion.store.record import require_name

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
            raise _wrong(line, f"'{name}' stands in line {lines[name]} already")
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
    """Find the separator of the heading; a column's name may hold one of the others."""
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
