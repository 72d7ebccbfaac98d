"""The parsers of a worker: confined, and never the same one for two owners."""

from __future__ import annotations

import contextlib
import logging
import os
from dataclasses import dataclass
from typing import Final

from modalmotion.formats import Parser, ParserHere, ReadLimits
from modalmotion.formats.parser.answer import Answer
from modalmotion.formats.parser.confinement import landlock_version
from modalmotion.formats.parser.forks import ParserForks, ParserLostError

logger = logging.getLogger(__name__)

# What a worker ends with that has lost its parsers.
_LOST: Final = 3

# Of this process, where it is a worker.
_forks: list[ParserForks] = []


@dataclass(frozen=True)
class _ConfinedParser:
    forks: ParserForks
    limits: ReadLimits

    def parse(self, task: str, data: bytes) -> Answer:
        try:
            return self.forks.parse(task, data, self.limits)
        except ParserLostError:
            # Whoever waits has the work done by another process, as if this one had been killed.
            os._exit(_LOST)


def begin_parsers() -> None:
    """Begin the process that forks parsers. For a worker that is new."""
    _forks[:] = [ParserForks()]


def parser_for(limits: ReadLimits) -> Parser:
    """Give a parser with these limits: a confined one in a worker.

    Parameters
    ----------
    limits : ReadLimits
    """
    return _ConfinedParser(_forks[0], limits) if _forks else ParserHere(limits)


def end_parser() -> None:
    """End the parser of an owner whose turn is over."""
    for forks in _forks:
        # One that was killed is found by the next file.
        with contextlib.suppress(ParserLostError):
            forks.end_parser()


def are_confined() -> bool:
    """Tell whether this system can confine parsers."""
    return landlock_version() > 0


def say_whether_confined() -> None:
    """Have the log say it, at the start."""
    if are_confined():
        logger.info("parsers of HDF5 and VTK are confined by Landlock")
    else:
        logger.warning(
            "parsers of HDF5 and VTK are not confined: this system has no Landlock, see "
            "docs/operations.md"
        )
