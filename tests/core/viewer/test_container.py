"""The form in which numbers travel to the viewer."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError
from modalmotion.viewer.container import MAGIC, read_container, write_container

ARRAYS: dict[str, NDArray[Any]] = {
    "a": np.arange(5, dtype=np.uint16),
    "b": np.linspace(0.0, 1.0, 7).reshape(7, 1),
    "c": np.zeros((0, 3), dtype=np.float32),
    "d": np.array([[1.5, -2.0]], dtype=np.float16),
}


def test_what_is_read_is_what_was_written() -> None:
    header, arrays = read_container(write_container({"title": "ä beat"}, ARRAYS))
    assert header == {"title": "ä beat"}
    assert list(arrays) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert arrays[name].dtype == array.dtype
        np.testing.assert_array_equal(arrays[name], array)


@pytest.mark.parametrize("title", ["", "a", "abc", "abcdefg"])
def test_every_array_begins_at_a_multiple_of_eight(title: str) -> None:
    data = write_container({"title": title}, ARRAYS)
    start = len(MAGIC) + 4 + int.from_bytes(data[8:12], "little")
    assert start % 8 == 0
    # The second array follows ten bytes of the first, padded.
    assert data[start + 16 : start + 16 + 56] == ARRAYS["b"].tobytes()


@pytest.mark.parametrize("data", [b"", b"MMVIEW1\n", b"x" * 40, None])
def test_other_bytes_are_refused(data: bytes | None) -> None:
    cut = write_container({}, ARRAYS)[:-60] if data is None else data
    with pytest.raises(MalformedFileError):
        read_container(cut)


def test_a_type_that_no_page_reads_is_a_fault_of_the_writer() -> None:
    with pytest.raises(TypeError, match="wide"):
        write_container({}, {"wide": np.zeros(2, dtype=np.int64)})
