"""Settings from the environment; errors name the variables."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from typing import Any, Final

from pydantic import ValidationError

from modalmotion.errors import ParameterError
from modalmotion_service.settings import Settings

_PREFIX: Final = "MODALMOTION_"

# A cluster that runs a service of this name sets these for everything in it.
_OF_OTHERS: Final = re.compile(r"(SERVICE|PORT)(_.*)?")


def read_settings(**stated: Any) -> Settings:
    """Read the settings.

    Parameters
    ----------
    **stated
        By name; they go over the environment.

    Raises
    ------
    ParameterError
        If a value is not valid for its setting; all of them are named.
    """
    try:
        return Settings(**stated)
    except ValidationError as error:
        faults = [
            f"{_PREFIX}{str(fault['loc'][0]).upper()} is {fault['input']!r}: {fault['msg']}."
            for fault in error.errors()
        ]
        raise ParameterError(
            " ".join(faults), remedy="docs/service.md lists the settings with their defaults."
        ) from error


def unknown_variables(environment: Mapping[str, str] = os.environ) -> Iterator[tuple[str, str]]:
    """Give variables that look like settings but are not, each with the nearest setting.

    A setting that is misspelt has its default: a service that should demand keys may not.
    """
    known = [name.upper() for name in Settings.model_fields]
    for name in sorted(environment):
        end = name.upper().removeprefix(_PREFIX)
        if end == name.upper() or end in known or _OF_OTHERS.fullmatch(end):
            continue
        yield name, "".join(f"{_PREFIX}{match}" for match in get_close_matches(end, known, n=1))
