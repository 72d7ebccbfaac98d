"""Covariates in the further columns of a table of files."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, Final

from modalmotion.facts.facts import LONGEST_NAME, LONGEST_WORD, Facts, stated_twice
from modalmotion.facts.texts import facts_from_texts, is_fact
from modalmotion.representation import is_readable

# Columns that name a file, and those that a table of results adds: `modalmotion cohort` writes
# such a table, and how well a case was fitted is not knowledge of the person.
_OTHERS: Final = frozenset(
    {
        *("path", "subject", "label", "sequence_id", "signature", "error"),
        *("rms_error", "weighted_rms_error", "unit"),
    }
)

# What spreadsheets and programs write where a value is missing.
_MISSING: Final = frozenset({"", "na", "n/a", "nan", "null", "nil", "#n/a", ".", "?"})

_NO_NAME: Final = re.compile(r"[=:;,\s]+")
_DECIMAL_COMMA: Final = re.compile(r"[+-]?[0-9]+,[0-9]+")


def states_fact(name: object) -> bool:
    """Whether a column of a table of files, named as by `column_of`, states a fact."""
    return isinstance(name, str) and bool(name) and name not in _OTHERS


def facts_in(row: Mapping[Any, Any], *, decimal_comma: bool = False) -> Facts:
    """Facts in a row of a table of files; every further column is a covariate.

    A column is a covariate unless it is the file's name, class or subject, a fact or a result.
    What cannot be one, such as a long remark, is passed over, and so is what is missing.

    Parameters
    ----------
    row : mapping of str to (str or number)
        By `column_of` of the heading.
    decimal_comma : bool
        Whether 61,5 is a number, as in tables whose columns commas do not part.

    Raises
    ------
    ParameterError
        If a fact cannot be read or is out of range, or one is stated twice.
    """
    stated = {name: row[name] for name in row if isinstance(name, str) and is_fact(name)}
    for column, content in row.items():
        if not states_fact(column) or is_fact(column):
            continue
        value = _covariate(content, decimal_comma=decimal_comma)
        name = _NO_NAME.sub(" ", column).strip()[:LONGEST_NAME].strip()
        if value is None or not _is_shown(name) or not name:
            continue
        if stated.get(f"covariate:{name}") not in (None, ""):
            raise stated_twice("covariate", name, name)
        stated[f"covariate:{name}"] = value
    return facts_from_texts(stated)


def _is_shown(text: str) -> bool:
    return text.isprintable() and is_readable(text)


def _covariate(content: Any, *, decimal_comma: bool) -> float | str | None:
    if isinstance(content, bool):
        return "yes" if content else "no"
    if isinstance(content, int | float):
        return content if math.isfinite(content) else None
    text = content.strip() if isinstance(content, str) else ""
    if text.lower() in _MISSING or len(text) > LONGEST_WORD or not _is_shown(text):
        return None
    return text.replace(",", ".") if decimal_comma and _DECIMAL_COMMA.fullmatch(text) else text
