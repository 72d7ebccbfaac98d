"""Facts as texts: in the columns of a table, in a query, on the command line."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

from modalmotion.errors import ParameterError
from modalmotion.facts.facts import NAMES, WORDS, Facts, require_fact_name, stated_twice
from modalmotion.facts.json_form import facts_from_json, read_object
from modalmotion.facts.places import read_landmark

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
    singles: dict[str, dict[str, Any]] = {"landmarks": {}, "covariates": {}}
    for name, text in texts.items():
        content = text.strip() if isinstance(text, str) else text
        if content is None or content == "":
            continue
        prefix = fact_prefix(name)
        if prefix is not None:
            own = name.partition(":")[2].strip()
            require_fact_name(prefix, own)
            _put(singles[_PREFIXES[prefix]], prefix, own, _value(prefix, own, content))
        elif isinstance(content, str):
            values[name] = _fact(name, content)
        else:
            values[name] = content
    for name, single in singles.items():
        stated = values.get(name, {})
        if single and isinstance(stated, Mapping):
            values[name] = dict(stated)
            for own, value in single.items():
                _put(values[name], name[:-1], own, value)
    return facts_from_json(values)


def _put(values: dict[str, Any], kind: str, name: str, value: Any) -> None:
    if name in values:
        raise stated_twice(kind, name, name)
    values[name] = value


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
            remedy="Leave it empty where it is missing.",
            details={"fact": "covariates", "name": name},
        )
    return float(content) if _NUMBER.fullmatch(content) else content
