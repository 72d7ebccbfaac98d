"""The patient's study: the header of an instance, kept in memory only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from modalmotion.errors import MalformedFileError
from modalmotion.formats import Parser
from modalmotion.formats.parser.process import ParserProcess
from modalmotion.limits import DEFAULT_LIMITS
from modalmotion.representation import shown


@shown()
@dataclass(frozen=True)
class Study:
    """What is copied from an instance into objects of the same study.

    Its `repr` does not show it, because it names a patient.

    Parameters
    ----------
    header : mapping of str to str
        By DICOM's keywords.
    """

    header: Mapping[str, str]

    @property
    def frame_of_reference(self) -> str | None:
        """UID of the instance's frame of reference."""
        return self.header["FrameOfReferenceUID"] or None

    def dataset(self) -> Any:
        """Return the header as a pydicom Dataset."""
        from pydicom.dataset import Dataset

        found = Dataset()
        found.SpecificCharacterSet = "ISO_IR 192"
        for name, value in self.header.items():
            if name != "FrameOfReferenceUID" or value:
                setattr(found, name, value)
        return found


def read_study(source: bytes | Path, *, parser: Parser | None = None) -> Study:
    """Read the header of an instance, in a disposable process.

    Parameters
    ----------
    source : bytes or Path
    parser : Parser, optional

    Raises
    ------
    MalformedFileError
        If it is not a DICOM instance; no value of it is named.
    MissingExtraError
        If pydicom is absent.
    """
    try:
        data = source.read_bytes() if isinstance(source, Path) else source
    except OSError as error:
        raise MalformedFileError(
            f"The instance cannot be read: {error.strerror}.", remedy="Name a DICOM file."
        ) from error
    if parser is None:
        with ParserProcess(DEFAULT_LIMITS) as own:
            return Study(own.parse("study", data).info["header"])
    return Study(parser.parse("study", data).info["header"])
