"""Facts as JSON, and as texts: in a table's columns, a query or a command."""

import json
import math
import re
from collections.abc import Mapping
from typing import Any, Final

from modalmotion.errors import ParameterError
from modalmotion.mesh.facts import (
    LONGEST_NAME,
    LONGEST_WORD,
    NAMES,
    NO_FACTS,
    WORDS,
    Facts,
    read_landmark,
    require_fact_name,
    stated_twice,
)
from modalmotion.representation import is_readable

LONGEST_TEXT: Final = 100_000
"""Characters of the JSON text of landmarks or covariates."""


def facts_as_json(facts: Facts) -> dict[str, Any]:
    """Return all facts, ready for JSON: "unknown", null or empty if they are unknown."""
    values = {name: getattr(facts, name) for name in NAMES}
    return {**values, "landmarks": dict(facts.landmarks), "covariates": dict(facts.covariates)}


def facts_from_json(values: Any) -> Facts:
    """Read the output of `facts_as_json`; missing or null facts are unknown.

    Raises
    ------
    ParameterError
        If something is not a fact, or is out of range.
    """
    return facts_patched(NO_FACTS, values)


def facts_patched(facts: Facts, changes: Any) -> Facts:
    """Change facts as a JSON merge patch does (RFC 7396).

    Parameters
    ----------
    facts : Facts
    changes : mapping
        A missing fact stays; null makes it unknown. Landmarks and covariates are changed name
        by name, and null takes one away.

    Raises
    ------
    ParameterError
        If something is not a fact, or the result is out of range or contradicts itself.
    """
    if not isinstance(changes, Mapping):
        raise ParameterError(
            f"The facts are {str(changes)[:40]!r}.",
            remedy=f"Give an object with members among {', '.join(NAMES)}.",
        )
    values: dict[str, Any] = {name: getattr(facts, name) for name in NAMES}
    for name, change in changes.items():
        if name not in NAMES:
            raise ParameterError(
                f"{str(name)[:40]!r} is not a fact.", remedy=f"State {', '.join(NAMES)}."
            )
        if name in WORDS:
            values[name] = "unknown" if change is None else change
        elif name in ("landmarks", "covariates"):
            values[name] = _merged(values[name], change)
        else:
            values[name] = change
    return Facts(**values)


def read_object(name: str, text: str) -> dict[str, Any]:
    """Read the JSON text of landmarks or covariates.

    Parameters
    ----------
    name : {"landmarks", "covariates"}
    text : str

    Raises
    ------
    ParameterError
        If it is not an object, names something twice, or contains NaN.
    """

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for key, value in pairs:
            if key in values:
                raise stated_twice(name[:-1], key, key)
            values[key] = value
        return values

    def refused(constant: str) -> Any:
        raise ValueError(f"{constant} is not a finite number")

    if len(text) > LONGEST_TEXT:
        raise _not_an_object(name, f"{len(text)} characters, more than {LONGEST_TEXT}")
    try:
        values = json.loads(text, object_pairs_hook=once, parse_constant=refused)
    except ParameterError:
        raise
    except (ValueError, RecursionError) as error:
        raise _not_an_object(name, str(error)) from error
    if not isinstance(values, dict):
        raise _not_an_object(name, f"it is a {type(values).__name__}")
    return values


def _merged(known: Mapping[str, Any], change: Any) -> Any:
    if change is None:
        return {}
    if not isinstance(change, Mapping):
        return change
    merged = {**known, **change}
    return {name: value for name, value in merged.items() if value is not None}


def _not_an_object(name: str, reason: str) -> ParameterError:
    example = '{"apex": [0, 0, -40]}' if name == "landmarks" else '{"age": 61, "sex": "f"}'
    return ParameterError(
        f"The {name} are not a JSON object ({reason[:100]}).",
        remedy=f"Write them as {example}.",
        details={"fact": name},
    )


_NUMBER: Final = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")

# What programs write where a number is missing.
_NO_NUMBER: Final = frozenset({"nan", "inf", "+inf", "-inf", "infinity", "-infinity"})

_PREFIXES: Final = {"landmark": "landmarks", "covariate": "covariates"}


def is_fact(name: str) -> bool:
    """Whether a column or parameter of this name states a fact."""
    return name in NAMES or fact_prefix(name) is not None


def column_of(heading: str) -> str:
    """Give the name of a column: capitals count only behind "landmark:" and "covariate:"."""
    name, colon, own = heading.strip().partition(":")
    name = name.strip().lower()
    if colon and name in _PREFIXES:
        return f"{name}:{own.strip()}"
    return heading.strip().lower()


def fact_prefix(name: str) -> str | None:
    """Prefix of a column's name: "covariate" of covariate:age; None of most."""
    prefix, colon, _ = name.partition(":")
    return prefix if colon and prefix in _PREFIXES else None


def facts_from_texts(texts: Mapping[str, Any]) -> Facts:
    """Read facts from texts by name.

    Parameters
    ----------
    texts : mapping of str to str
        By the names of facts, landmarks and covariates as JSON; or one by one, as
        "landmark:apex" (7, or 0,0,-40) and "covariate:age" (61, or a word). An empty text, or
        None, states nothing. Values other than texts are taken as they are. Capitals do not
        matter in words.

    Raises
    ------
    ParameterError
        If one cannot be read or is out of range, or is stated twice.
    """
    values: dict[str, Any] = {}
    singles: dict[str, list[tuple[str, Any]]] = {"landmarks": [], "covariates": []}
    for name, text in texts.items():
        content = text.strip() if isinstance(text, str) else text
        if content is None or content == "":
            continue
        prefix = fact_prefix(name)
        if prefix is not None:
            own = name.partition(":")[2].strip()
            require_fact_name(prefix, own)
            singles[_PREFIXES[prefix]].append((own, _value(prefix, own, content)))
        elif isinstance(content, str):
            values[name] = _fact(name, content)
        else:
            values[name] = content
    for name, single in singles.items():
        stated = values.get(name, {})
        if single and isinstance(stated, Mapping):
            # Pairs, of which facts refuse a name that is stated twice.
            known = [(own, value) for own, value in stated.items() if value is not None]
            values[name] = [*known, *single]
    return facts_from_json(values)


def _fact(name: str, text: str) -> Any:
    if name in WORDS:
        return next((word for word in WORDS[name] if word.lower() == text.lower()), text)
    if name in _PREFIXES.values():
        return read_object(name, text)
    if name == "period":
        return float(text) if _NUMBER.fullmatch(text) else text
    return text


def _value(prefix: str, name: str, content: Any) -> Any:
    if not isinstance(content, str):
        return content
    if prefix == "landmark":
        return read_landmark(content, name)
    if content.lower() in _NO_NUMBER:
        raise ParameterError(
            f"The covariate '{name}' is {content!r}, which is not a finite number.",
            remedy="Leave it empty if it is missing.",
            details={"fact": "covariates", "name": name},
        )
    return float(content) if _NUMBER.fullmatch(content) else content


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
