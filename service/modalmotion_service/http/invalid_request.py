"""What to do about a request that does not fit its description, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

_ELSE: Final = "See /docs for the parameters of this call."

_OF_TYPE: Final = {
    **dict.fromkeys(
        ("int_parsing", "int_type", "int_from_float"), "Send {name} as a whole number."
    ),
    **dict.fromkeys(("float_parsing", "float_type"), "Send {name} as a number."),
    **dict.fromkeys(("bool_parsing", "bool_type"), "Send {name} as true or false."),
    **dict.fromkeys(("literal_error", "enum"), "Send {name} as {expected}."),
    **dict.fromkeys(
        ("dict_type", "model_type", "model_attributes_type"), "Send {name} as an object."
    ),
    "misplaced": "Send {name} in the query; /docs has the names that are read.",
    "missing": "State {name}.",
    "extra_forbidden": "Leave {name} out; /docs has the names that are read.",
    "json_invalid": "Send a body that is JSON.",
    "list_type": "Send {name} as a list.",
    "string_type": "Send {name} as text.",
    "finite_number": "Send {name} as a number that is finite.",
    "greater_than": "Send {name} of more than {gt}.",
    "greater_than_equal": "Send {name} of {ge} or more.",
    "less_than": "Send {name} of less than {lt}.",
    "less_than_equal": "Send {name} of {le} or less.",
    "string_too_long": "Send {name} of {max_length} characters or fewer.",
    "string_too_short": "Send {name} of {min_length} characters or more.",
    "string_pattern_mismatch": "Send {name} so that it matches {pattern}.",
    "too_long": "Send {name} of {max_length} entries or fewer.",
    "too_short": "Send {name} of {min_length} entries or more.",
}
"""By pydantic's name of the error, or our own; names in braces are those of its context."""

# Of a value that may be of several kinds each has an error, at a place named after the kind.
_KINDS: Final = {"int", "float", "str", "bool", "constrained-str", "constrained-int"}


def remedy_of(errors: Sequence[Mapping[str, Any]]) -> str:
    """Say what to do about the first error of a request.

    Parameters
    ----------
    errors : sequence of mapping
        As pydantic gives them: `type`, `loc` and mostly `ctx`; each may be missing.
    """
    if not errors:
        return _ELSE
    where = _place(errors[0])
    alike = [error for error in errors if _place(error) == where]
    return " Or: ".join(dict.fromkeys(_remedy(error, where) for error in alike))


def _place(error: Mapping[str, Any]) -> str:
    parts = [str(part) for part in error.get("loc", ())[1:]]
    while parts and (parts[-1] in _KINDS or "[" in parts[-1]):
        parts.pop()
    return ".".join(parts)


def _remedy(error: Mapping[str, Any], where: str) -> str:
    text = _OF_TYPE.get(error.get("type", ""), _ELSE)
    try:
        return text.format_map({**error.get("ctx", {}), "name": where or "the body"})
    except KeyError:
        return _ELSE
