"""What a legacy .vtk file declares is compared with its bytes, in any case and on any line."""

from __future__ import annotations

import numpy as np
import pytest
from format_samples import FACES, VERTICES, vtk_text

from modalmotion.errors import InputError, LimitError, MalformedFileError
from modalmotion.formats.vtk_legacy_gate import require_plain_legacy
from modalmotion.limits import DEFAULT_LIMITS

PLAIN = vtk_text(VERTICES[0])
BINARY = (
    b"# vtk DataFile Version 3.0\nmade by a test\nBINARY\nDATASET POLYDATA\nPOINTS 12 float\n"
    + VERTICES[0].astype(">f4").tobytes()
    + b"\nPOLYGONS 12 48\n"
    + np.insert(FACES, 0, 3, axis=1).astype(">i4").tobytes()
    + b"\n"
)


def test_plain_files_pass() -> None:
    require_plain_legacy(PLAIN, DEFAULT_LIMITS)
    require_plain_legacy(BINARY, DEFAULT_LIMITS)
    require_plain_legacy(vtk_text(VERTICES[0], [[0, 1, 2], [0, 1, 2, 3], []]), DEFAULT_LIMITS)
    require_plain_legacy(PLAIN.replace(b"made by a test", b"POINTS 99999 float"), DEFAULT_LIMITS)


@pytest.mark.parametrize(
    "size", [b"1900000", b"999999999", b"99999999999999999999", b"-12", b"+9999"]
)
@pytest.mark.parametrize(
    "word", [b"POINTS ", b"points ", b"Points\t", b"pOINTS\n\n", b"points \r\n"]
)
@pytest.mark.parametrize("before", [b"\n", b" ", b" \t"])
def test_a_size_is_read_however_it_is_written(before: bytes, word: bytes, size: bytes) -> None:
    data = PLAIN.replace(b"\nPOINTS 12", before + word + size)
    with pytest.raises(InputError) as caught:
        require_plain_legacy(data, DEFAULT_LIMITS)
    assert "declares" in str(caught.value)


@pytest.mark.parametrize(
    "section",
    [
        b"polygons 99999 9\n",
        b"LINES 1 9999999\n",
        b"vertices 9999999 1\n",
        b"Triangle_Strips 1 9999999\n",
        b"POINT_DATA 9999999\n",
        b"cell_data 9999999\n",
        b"FIELD a 9999999\n",
        b"field a 1 b 99999 99999 FLOAT\n",
        b"LOOKUP_TABLE a 9999999\n",
        b"point_data 12 scalars a float 9999\n",
        b"point_data 12 color_scalars a 9999\n",
        b"METADATA INFORMATION 9999999 NAME a DATA 9999999 1\n",
        b"FIELD " + b"x" * 1000 + b" 1\n",
        b"x" * 1000,
        b"polygons 1 4 900000000 0 1 2\n",
        b"polygons 1 4 -3 0 1 2\n",
        b"polygons 1 4 2 0 1 2\n",
        b"lines 1 3 9 0 1\n",
    ],
)
def test_sizes_of_all_sections_are_read(section: bytes) -> None:
    with pytest.raises(MalformedFileError) as caught:
        require_plain_legacy(PLAIN + section, DEFAULT_LIMITS)
    assert caught.value.remedy


def test_corners_in_binary_files_are_followed_too() -> None:
    first = np.array([3, *FACES[0]], ">i4").tobytes()
    damaged = BINARY.replace(first, b"\x7f" + first[1:], 1)
    with pytest.raises(MalformedFileError, match="do not add up"):
        require_plain_legacy(damaged, DEFAULT_LIMITS)


def test_many_arrays_are_refused() -> None:
    arrays = b"".join(b"a%d 1 1 float\n0\n" % i for i in range(1000))
    with pytest.raises(LimitError) as caught:
        require_plain_legacy(PLAIN + b"FIELD f 1000\n" + arrays, DEFAULT_LIMITS)
    assert caught.value.limit == "vtk_arrays"
