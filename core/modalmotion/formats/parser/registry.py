"""Parsers that rest on libraries which damaged files can bring down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Final

from modalmotion.formats.parser.answer import Answer, Parsed
from modalmotion.limits import ReadLimits

# Imported only where they run: h5py and VTK are slow to import, and VTK is an extra.
_TASKS: Final = {
    "hdf5": "modalmotion.formats.parser.hdf5:parse_hdf5",
    "vtk": "modalmotion.formats.vtk.vtk_polydata:parse_legacy",
    "vtp": "modalmotion.formats.vtk.vtk_polydata:parse_xml",
}


@dataclass(frozen=True)
class ParserHere:
    """Parses in this very process.

    For processes that may be lost and are limited from outside, such as a worker of the
    service: it saves the second that a process of its own takes to start.

    Parameters
    ----------
    limits : ReadLimits
    """

    limits: ReadLimits

    def parse(self, task: str, data: bytes) -> Answer:
        """Parse a file.

        Raises
        ------
        InputError
            What the parser raised.
        """
        return Answer(*parser_of(task)(data, self.limits))


def parser_of(task: str) -> Callable[[bytes, ReadLimits], Parsed]:
    """Find a parser by its name."""
    module, _, function = _TASKS[task].partition(":")
    parse: Callable[[bytes, ReadLimits], Parsed] = getattr(import_module(module), function)
    return parse
