"""Answers of parsers, and the protocol of those who call them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from numpy.typing import NDArray

from modalmotion.limits import ReadLimits

Parsed = tuple[dict[str, Any], dict[str, NDArray[Any]]]
"""Text and numbers by name, and arrays by name."""


@dataclass(frozen=True, eq=False)
class Answer:
    """What a parser found.

    Parameters
    ----------
    info : dict
        Text and numbers.
    arrays : dict of ndarray
    """

    info: dict[str, Any]
    arrays: dict[str, NDArray[Any]]


class Parser(Protocol):
    """Something that has files parsed: `ParserProcess`, or `ParserHere`."""

    @property
    def limits(self) -> ReadLimits:
        """How large a file may be."""

    def parse(self, task: str, data: bytes) -> Answer:
        """Have a file parsed by the parser of that name."""
