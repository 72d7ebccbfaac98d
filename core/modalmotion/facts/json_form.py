"""Facts as JSON: in answers, and in requests that change them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

from modalmotion.errors import ParameterError
from modalmotion.facts.facts import NAMES, NO_FACTS, WORDS, Facts, stated_twice

LONGEST_TEXT: Final = 100_000
"""Characters of the JSON text of landmarks or covariates."""


def facts_as_json(facts: Facts) -> dict[str, Any]:
    """Return all facts, ready for JSON: "unknown", null or empty where they are unknown."""
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
        If it is not an object, names something twice, or holds NaN.
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
