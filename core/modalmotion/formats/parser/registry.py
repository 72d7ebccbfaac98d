"""Parsers that use libraries which damaged files can crash."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Final

from modalmotion.formats.result import Answer, Parsed
from modalmotion.limits import ReadLimits

# Imported only where they run: h5py and VTK are slow to import, and VTK is an extra.
_TASKS: Final = {
    "hdf5": "modalmotion.formats.parser.hdf5:parse_hdf5",
    "clouds": "modalmotion.formats.parser.hdf5:parse_clouds",
    "dicom": "modalmotion.formats.volumes.dicom:parse_dicom",
    "metaimage": "modalmotion.formats.volumes.nrrd_metaimage:parse_metaimage",
    "nifti": "modalmotion.formats.volumes.nifti:parse_nifti",
    "nrrd": "modalmotion.formats.volumes.nrrd_metaimage:parse_nrrd",
    "study": "modalmotion.formats.volumes.dicom:parse_study",
    "mat": "modalmotion.formats.named_arrays:parse_matlab",
    "datasets": "modalmotion.formats.parser.hdf5:parse_datasets",
}

# Of images, which may be of one colour: packed to nothing, and not in proportion to their files.
_OF_IMAGES: Final = ("dicom", "metaimage", "nifti", "nrrd", "study")

# What they import in turn.
_LIBRARIES: Final = {
    **dict.fromkeys(("hdf5", "clouds", "datasets"), ("h5py", "encodings.ascii")),
    "mat": ("scipy.io",),
    "dicom": ("pydicom.pixels",),
    "nifti": ("nibabel",),
    "nrrd": ("nrrd",),
    "study": ("pydicom.valuerep",),
}


@dataclass(frozen=True)
class ParserHere:
    """Runs parsers in this process.

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
        return Answer(*parser_of(task)(data, limits_on(task, len(data), self.limits)))


def parser_of(task: str) -> Callable[[bytes, ReadLimits], Parsed]:
    """Find a parser by its name."""
    module, _, function = _TASKS[task].partition(":")
    parse: Callable[[bytes, ReadLimits], Parsed] = getattr(import_module(module), function)
    return parse


def limits_on(task: str, n_bytes: int, limits: ReadLimits) -> ReadLimits:
    """Give the limits on a file of that size."""
    return limits if task in _OF_IMAGES else limits.of_file(n_bytes)


def prepare(task: str) -> None:
    """Import what a parser needs."""
    parser_of(task)
    for library in _LIBRARIES.get(task, ()):
        import_module(library)
