"""Uploads and their parsers, which are confined and never the same for two owners."""

import logging
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

from pydantic import PlainSerializer, PlainValidator

from modalmotion.errors import InputError
from modalmotion.formats import (
    DEFAULT_LIMITS,
    Parser,
    ParserHere,
    Reading,
    ReadLimits,
    ReadOptions,
    read_sequence,
)
from modalmotion.formats.frame import SIGNATURE, TRACK
from modalmotion.formats.parser_child import landlock_version
from modalmotion.formats.parser_process import ParserLostError, ParserProcess
from modalmotion.formats.result import Answer
from modalmotion.formats.volumes import read_images
from modalmotion.images import ImageSequence
from modalmotion.mesh.fact_forms import facts_as_json, facts_from_json
from modalmotion.mesh.facts import NO_FACTS, UNKNOWN, Facts
from modalmotion.progress import Reporter
from modalmotion.tracking.reading import Recorded, read_observed

logger = logging.getLogger(__name__)

# What a worker ends with that has lost its parsers.
_LOST: Final = 3

# A task ends before, by its own deadline.
_LONGEST_SECONDS: Final = 3600.0

# Of this process, where it is a worker.
_parsers: list[ParserProcess] = []


@dataclass(frozen=True)
class _ConfinedParser:
    process: ParserProcess
    limits: ReadLimits

    def parse(self, task: str, data: bytes) -> Answer:
        self.process.limits = self.limits
        try:
            return self.process.parse(task, data)
        except ParserLostError:
            # Whoever waits has the work done by another process, as if this one had been killed.
            os._exit(_LOST)


def confine_parsers() -> None:
    """Have files parsed in another process from here on. For a worker that is new."""
    _parsers[:] = [ParserProcess(DEFAULT_LIMITS, _LONGEST_SECONDS)]


def parser_for(limits: ReadLimits) -> Parser:
    """Give a parser with these limits: a confined one in a worker.

    Parameters
    ----------
    limits : ReadLimits
    """
    return _ConfinedParser(_parsers[0], limits) if _parsers else ParserHere(limits)


def end_parser() -> None:
    """End the parser of an owner whose turn is over."""
    for parser in _parsers:
        parser.close()


def are_confined() -> bool:
    """Return whether this system can confine parsers."""
    return landlock_version() > 0


def say_whether_confined() -> None:
    """Have the log say it, at the start."""
    if are_confined():
        logger.info("parsers of HDF5, MATLAB and images are confined by Landlock")
    else:
        logger.warning(
            "parsers of HDF5, MATLAB and images are not confined: this system has no Landlock, see "
            "docs/operations.md"
        )


# Commands that remedies name, and the calls that do the same here.
_CALLS: Final = {TRACK: "POST /v1/tracks", SIGNATURE: "POST /v1/sequences"}


@dataclass(frozen=True)
class Upload:
    """A file that was sent, and what its sender says of it.

    Parameters
    ----------
    path : Path
    options : ReadOptions
    part : Part, optional
        The part of the file that it is, where many are in one.
    """

    path: Path
    options: ReadOptions
    part: "Part | None" = None

    @staticmethod
    def at(path: Path, limits: ReadLimits) -> "Upload":
        """Give a file of which nothing is said."""
        return Upload(path, ReadOptions(limits=limits))

    @property
    def n_bytes(self) -> int:
        """Size of it; 0 of a file that is gone."""
        if self.part is not None:
            return self.part.length
        try:
            return self.path.stat().st_size
        except OSError:
            return 0

    def data(self, most: int | None = None) -> bytes:
        """Give its bytes, or the first of them.

        Parameters
        ----------
        most : int, optional
        """
        start, length = (0, -1) if self.part is None else (self.part.start, self.part.length)
        if most is not None:
            length = most if length < 0 else min(most, length)
        with self.path.open("rb", buffering=0) as file:
            file.seek(start)
            return file.read(length)

    def read(self, progress: Reporter | None = None) -> Reading:
        """Read it, in a worker.

        Parameters
        ----------
        progress : callable, optional
            Told of frames that are files of their own.

        Raises
        ------
        InputError
            If it is not understood, or beyond a limit.
        """
        with _own_words():
            parser = parser_for(self.options.limits)
            return read_sequence(self.data(), self.options, parser=parser, progress=progress)

    def observed(
        self,
        labels: Sequence[str | int],
        coordinates: str = UNKNOWN,
        progress: Reporter | None = None,
    ) -> Recorded:
        """Read it as observations that do not correspond, in a worker.

        Parameters
        ----------
        labels : sequence of str
            Of typed contours: parts of the names of those to read.
        coordinates : str, optional
            Of points whose files state none.
        progress : callable, optional

        Raises
        ------
        InputError
            If it is not understood, or beyond a limit.
        """
        with _own_words():
            return read_observed(
                self.data(),
                labels=labels,
                coordinates=coordinates,
                parser=parser_for(self.options.limits),
                progress=progress,
            )

    def images(self, progress: Reporter | None = None) -> ImageSequence:
        """Read it as images, in a worker.

        Parameters
        ----------
        progress : callable, optional

        Raises
        ------
        InputError
            If it holds none, or is beyond a limit.
        """
        with _own_words(decompressed_bytes="image_bytes"):
            parser = parser_for(self.options.limits)
            return read_images(self.data(), parser=parser, progress=progress)


@contextmanager
def _own_words(**limits: str) -> Iterator[None]:
    """Have errors name calls and limits as they are called here."""
    try:
        yield
    except InputError as error:
        for command, call in _CALLS.items():
            error.remedy = error.remedy.replace(command, call)
        error.limit = limits.get(error.limit or "", error.limit)
        raise


FactsAsJson = Annotated[Facts, PlainValidator(facts_from_json), PlainSerializer(facts_as_json)]


@dataclass(frozen=True)
class Part:
    """One file of many that are in one, one after the other.

    Parameters
    ----------
    name : str
        As the sender calls it.
    start, length : int, bytes
    subject, label : str or None
    facts : Facts
    """

    name: str
    start: int
    length: int
    subject: str | None = None
    label: str | None = None
    facts: FactsAsJson = NO_FACTS
