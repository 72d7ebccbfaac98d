"""DICOM data sets from bytes: which compressed ones are decoded, and that they unfold alike."""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from typing import Any, Final

from modalmotion.errors import MalformedFileError

_REMEDY: Final = "Export it without compression (Explicit VR Little Endian)."

_RLE: Final = "1.2.840.10008.1.2.5"
_JPEG_2000: Final = ("1.2.840.10008.1.2.4.90", "1.2.840.10008.1.2.4.91")

# Start of a codestream, and of its sizes (ISO/IEC 15444-1, A.5.1): right, lower, left, upper end.
_START: Final = b"\xff\x4f\xff\x51"
_SIZES: Final = (8, 12, 16, 20)

# Bytes of the table of segments in front of RLE's own (DICOM PS3.5, G.5).
_TABLE: Final = 64
_NO_RUN: Final = 128


class _Stream(io.BytesIO):
    def read(self, size: int | None = -1, /) -> bytes:
        """Read so many bytes; all of the rest is what deflated data sets are inflated from."""
        if size is None or size < 0:
            raise MalformedFileError(
                "The DICOM file is deflated, which would unfold to any size.", remedy=_REMEDY
            )
        return super().read(size)


def read_dicom(data: bytes, tags: Sequence[str], *, has_pixels: bool = True) -> Any:
    """Read elements of a file, its pixels too if it `has_pixels` to be read.

    Raises
    ------
    MalformedFileError
        If it is deflated as a whole.
    pydicom.errors.InvalidDicomError, OSError, ValueError, ...
        What pydicom raises on other files.
    """
    import pydicom

    stream = _Stream(data)
    return pydicom.dcmread(stream, stop_before_pixels=not has_pixels, specific_tags=list(tags))


def require_decodable(dataset: Any, n: int, rows: int, columns: int) -> None:
    """Refuse compressed pixels that nothing here decodes, or that unfold to another size.

    RLE is decoded by pydicom alone, JPEG 2000 by Pillow.

    Raises
    ------
    MalformedFileError
        It names the compression, and the package that is missing.
    """
    from pydicom.encaps import generate_frames
    from pydicom.pixels import get_decoder

    syntax = dataset.file_meta.TransferSyntaxUID
    if syntax != _RLE and syntax not in _JPEG_2000:
        raise MalformedFileError(
            f"The pixels of the DICOM file are compressed as {syntax.name}; RLE and JPEG 2000 are "
            "read.",
            remedy=_REMEDY,
        )
    if not get_decoder(syntax).is_available:
        raise MalformedFileError(
            f"The pixels of the DICOM file are compressed as {syntax.name}, which Pillow decodes.",
            remedy=f"Run: pip install pillow. Or: {_REMEDY[0].lower()}{_REMEDY[1:]}",
        )
    unfolds = _unfolds_by_runs if syntax == _RLE else _is_codestream
    frames = generate_frames(dataset.PixelData, number_of_frames=n)
    if not all(unfolds(frame, rows, columns) for frame in frames):
        raise MalformedFileError(
            f"The compressed pixels of the DICOM file are not {rows} x {columns} samples.",
            remedy=_REMEDY,
        )


def _is_codestream(frame: bytes, rows: int, columns: int) -> bool:
    """Whether a codestream of JPEG 2000 declares so many samples."""
    at = frame.find(_START)
    right, lower, left, upper = (int.from_bytes(frame[at + i : at + i + 4], "big") for i in _SIZES)
    return at >= 0 and (lower - upper, right - left) == (rows, columns)


def _unfolds_by_runs(frame: bytes, rows: int, columns: int) -> bool:
    """Whether no segment of RLE, one byte of each sample, unfolds to more than so many samples."""
    n, *table = struct.unpack("<16L", frame[:_TABLE])
    ends = [*table[1:n], len(frame)]
    pairs = zip(table[:n], ends, strict=True)
    return all(_unfolds_to(frame[start:end], rows * columns) for start, end in pairs)


def _unfolds_to(segment: bytes, most: int) -> bool:
    """Whether runs unfold to no more than so many bytes."""
    n, at = 0, 0
    # What is left of a row is padded by one byte.
    while at < len(segment) - 1 and n <= most:
        head = segment[at]
        if head < _NO_RUN:
            n += head + 1
            at += head + 2
        elif head > _NO_RUN:
            n += 257 - head
            at += 2
        else:
            at += 1
    return n <= most
