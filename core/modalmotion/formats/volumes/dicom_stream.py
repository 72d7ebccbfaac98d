"""DICOM data sets from bytes, a deflated one no further than its header declares."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any, Final

from modalmotion.errors import MalformedFileError
from modalmotion.formats.volumes.stack import declared_bytes
from modalmotion.limits import ReadLimits
from modalmotion.numeric.unpacking import unpacked, unpacked_head

_EXPLICIT: Final = b"1.2.840.10008.1.2.1\0"
# Preamble and transfer syntax of a data set that is not deflated: little-endian, explicit.
_PLAIN_HEAD: Final = bytes(128) + b"DICM\x02\x00\x10\x00UI\x14\x00" + _EXPLICIT
# Of what stands before the pixels, icons and private elements included.
_LONGEST_HEADER: Final = 1 << 24
_PIXEL_DATA: Final = 0x7FE00010
# Tag, type and length of the pixels.
_ELEMENT_HEAD: Final = 12


class _DeflatedError(Exception):
    """The rest of the file is one deflated stream, which pydicom would inflate to any size."""


class _Stream(io.BytesIO):
    def read(self, size: int | None = -1, /) -> bytes:
        """Read so many bytes; all of the rest is what deflated data sets are read by."""
        if size is None or size < 0:
            raise _DeflatedError
        return super().read(size)


def read_dicom(
    data: bytes, tags: Sequence[str], limits: ReadLimits, *, has_pixels: bool = True
) -> Any:
    """Read elements of a file, its pixels too if it `has_pixels` to be read.

    Raises
    ------
    MalformedFileError, LimitError
        If deflated pixels are more or fewer than it declares, or more than `limits` accept.
    pydicom.errors.InvalidDicomError, OSError, ValueError, ...
        What pydicom raises on other files.
    """
    import pydicom

    stream = _Stream(data)
    try:
        return pydicom.dcmread(stream, stop_before_pixels=not has_pixels, specific_tags=list(tags))
    except _DeflatedError:
        start = stream.tell()
    head = io.BytesIO(_PLAIN_HEAD + unpacked_head(data, "deflate", _LONGEST_HEADER, start))
    dataset = pydicom.dcmread(head, stop_before_pixels=True, specific_tags=list(tags))
    # It stopped in front of the pixels.
    element = head.read(_ELEMENT_HEAD)
    if not has_pixels or len(element) < _ELEMENT_HEAD:
        return dataset
    names = ("Rows", "Columns", "SamplesPerPixel", "NumberOfFrames")
    shape = [int(dataset.get(name) or 1) for name in names]
    n_bytes = declared_bytes(shape, int(dataset.get("BitsAllocated") or 16) // 8 or 1, limits)
    length = int.from_bytes(element[8:], "little")
    # Padded to whole words.
    if not 0 <= length - n_bytes <= 1:
        raise MalformedFileError(
            f"The DICOM file declares pixels of {n_bytes} bytes and holds {length}.",
            remedy="Export it without compression (Explicit VR Little Endian).",
        )
    before = head.tell() - len(_PLAIN_HEAD)
    plain = unpacked(data, "deflate", before + length, start, goes_on=True)
    dataset.add_new(_PIXEL_DATA, element[4:6].decode("ascii"), plain[before:].data)
    return dataset
