"""Answers of parsers, and the protocol of their callers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from numpy.typing import NDArray

from modalmotion.limits import ReadLimits

Parsed = tuple[dict[str, Any], dict[str, NDArray[Any]]]
"""Text and numbers by name, and arrays by name."""


@dataclass(frozen=True, eq=False)
class Answer:
    """A parser's result.

    Parameters
    ----------
    info : dict
        Text and numbers.
    arrays : dict of ndarray
    """

    info: dict[str, Any]
    arrays: dict[str, NDArray[Any]]


class Parser(Protocol):
    """Runs parsers on files: `ParserProcess`, or `ParserHere`."""

    @property
    def limits(self) -> ReadLimits:
        """Limits on a file."""

    def parse(self, task: str, data: bytes) -> Answer:
        """Parse a file by the parser of that name."""


@dataclass(frozen=True)
class ParserOfFile:
    """A parser for what is inside one file, with that file's limits.

    Parameters
    ----------
    parser : Parser
    limits : ReadLimits
    """

    parser: Parser
    limits: ReadLimits

    def parse(self, task: str, data: bytes) -> Answer:
        """Parse a file inside of it."""
        return self.parser.parse(task, data)
