"""An upload: a file that was sent, and what its sender says of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from modalmotion.errors import InputError, LimitError
from modalmotion.formats import Reading, ReadOptions, read_sequence
from modalmotion.formats.frames.frame import SIGNATURE, TRACK
from modalmotion.formats.volumes import read_images
from modalmotion.images import ImageSequence
from modalmotion.mesh import NO_FACTS, Facts, facts_as_json, facts_from_json
from modalmotion.progress import Progress
from modalmotion.tracking.reading import Recorded, read_observed
from modalmotion_service.work.parsing import parser_for

# Commands that remedies name, as their doors are called here.
_DOORS: Final = {TRACK: "POST /v1/tracks", SIGNATURE: "POST /v1/sequences"}


@dataclass(frozen=True)
class Upload:
    """A file that was sent, and what its sender says of it.

    Parameters
    ----------
    path : Path
    options : ReadOptions
    part : Part, optional
        The part of the file that it is, where many lie in one.
    """

    path: Path
    options: ReadOptions
    part: Part | None = None

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

    def read(self, progress: Progress | None = None) -> Reading:
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
        parser = parser_for(self.options.limits)
        data = self.data()
        try:
            return read_sequence(data, self.options, parser=parser, progress=progress)
        except InputError as error:
            _name_doors(error)
            raise

    def observed(
        self,
        contours: Sequence[str],
        coordinates: str | None = None,
        progress: Progress | None = None,
    ) -> Recorded:
        """Read it as observations that do not correspond, in a worker.

        Parameters
        ----------
        contours : sequence of str
            Of typed contours: parts of the names of those to read.
        coordinates : str, optional
            Of points whose files state none.
        progress : callable, optional

        Raises
        ------
        InputError
            If it is not understood, or beyond a limit.
        """
        parser = parser_for(self.options.limits)
        try:
            return read_observed(
                self.data(),
                contours=contours,
                coordinates=coordinates,
                parser=parser,
                progress=progress,
            )
        except InputError as error:
            _name_doors(error)
            raise

    def images(self, progress: Progress | None = None) -> ImageSequence:
        """Read it as images, in a worker.

        Parameters
        ----------
        progress : callable, optional

        Raises
        ------
        InputError
            If it holds none, or is beyond a limit.
        """
        parser = parser_for(self.options.limits)
        try:
            return read_images(self.data(), parser=parser, progress=progress)
        except LimitError as error:
            # As `/v1/limits` calls it.
            if error.limit == "decompressed_bytes":
                error.limit = "image_bytes"
            raise


def _name_doors(error: InputError) -> None:
    for command, door in _DOORS.items():
        error.remedy = error.remedy.replace(command, door)


@dataclass(frozen=True)
class Part:
    """One file of many that lie in one, one after the other.

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
    facts: Facts = NO_FACTS


def parts_as_json(parts: Iterable[Part]) -> list[dict[str, Any]]:
    """Write parts as a job remembers them."""
    return [{**vars(part), "facts": facts_as_json(part.facts)} for part in parts]


def parts_from_json(values: Iterable[Mapping[str, Any]]) -> tuple[Part, ...]:
    """Read what `parts_as_json` gave."""
    return tuple(Part(**{**one, "facts": facts_from_json(one["facts"])}) for one in values)
