"""Lists, matrices and plain numbers: they come back, and are read by the text alone."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from text_of_numbers import Coded, matrix, mixed_matrix, number_list

from modalmotion.codec.coder import LARGEST_MAGNITUDE, Coder
from modalmotion.errors import MalformedFileError

Ints = NDArray[np.int64]


def any_matrix(rng: np.random.Generator, largest: float) -> Ints:
    shape = int(rng.integers(1, 12)), int(rng.integers(1, 90))
    falls = np.exp(-np.arange(shape[0])[:, None] / 5 - np.arange(shape[1]) / rng.uniform(5, 90))
    values: Ints = np.rint(10 ** rng.uniform(-1, largest) * falls * rng.laplace(size=shape))
    return values.astype(np.int64)


@pytest.mark.parametrize("mixed", [True, False])
@pytest.mark.parametrize("largest", [2.0, 10.0])
def test_matrices_come_back_and_are_as_the_text_says(
    mixed: bool, largest: float, rng: np.random.Generator
) -> None:
    for _ in range(4):
        values, numbers = any_matrix(rng, largest), rng.integers(0, 40, 21) ** 3
        writer = Coder()
        writer.numbers(21, numbers)
        writer.matrix((values.shape[0], values.shape[1]), values, mixed=mixed)
        writer.bits(3, 5, np.array([7, 31, 0]))
        data = writer.finish()
        reader = Coder(data)
        assert np.array_equal(reader.numbers(21, None), numbers)
        found = reader.matrix((values.shape[0], values.shape[1]), None, mixed=mixed)
        assert np.array_equal(found, values)
        assert reader.bits(3, 5, None).tolist() == [7, 31, 0]
        coded = Coded(data)
        assert number_list(coded, 21) == numbers.tolist()
        told = (mixed_matrix if mixed else matrix)(coded, *values.shape)
        assert np.array_equal(told, values)
        assert [coded.bits(5) for _ in range(3)] == [7, 31, 0]


@pytest.mark.parametrize("mixed", [True, False])
def test_a_writer_whose_room_is_too_small_grows(mixed: bool, rng: np.random.Generator) -> None:
    values = rng.integers(-(2**35), 2**35, size=(20, 200))
    values[3, 7], values[5, 0] = LARGEST_MAGNITUDE, -LARGEST_MAGNITUDE
    widths = rng.integers(0, 2**33, 3000)
    writer = Coder()
    writer.bits(3000, 33, widths)
    writer.matrix((20, 200), values, mixed=mixed)
    data = writer.finish()
    assert len(data) > 4 * 4 * 1024
    reader = Coder(data)
    assert np.array_equal(reader.bits(3000, 33, None), widths)
    assert np.array_equal(reader.matrix((20, 200), None, mixed=mixed), values)


@pytest.mark.every(2)
@pytest.mark.parametrize("scale", [0.0, 0.3, 5.0, 4000.0])
def test_mixed_matrices_are_not_larger(scale: float) -> None:
    rng = np.random.default_rng(4)
    falls = np.exp(-np.arange(12)[:, None] / 4 - np.arange(150) / 40)
    values = np.rint(scale * 4 * falls * rng.laplace(size=(12, 150))).astype(np.int64)
    sizes = []
    for mixed in (False, True):
        writer = Coder()
        writer.matrix((12, 150), values, mixed=mixed)
        sizes.append(len(writer.finish()))
    # Chance alone: what is left to learn is the same for both.
    assert sizes[1] <= 1.05 * sizes[0] + 8


def test_more_entries_than_are_mixed_are_refused() -> None:
    values = np.ones((1025, 1024), dtype=np.int64)
    for mixed in (True, False):
        writer = Coder()
        if mixed:
            with pytest.raises(MalformedFileError, match="larger than can be coded"):
                writer.matrix((1025, 1024), values, mixed=True)
        else:
            writer.matrix((1025, 1024), values, mixed=False)
            assert len(writer.finish()) < 200_000


def test_damage_is_refused(rng: np.random.Generator) -> None:
    writer = Coder()
    writer.matrix((4, 4), np.full((4, 4), 1000), mixed=False)
    data = writer.finish()
    with pytest.raises(MalformedFileError, match="declares 4 words"):
        Coder(b"\x04" + bytes(15))
    with pytest.raises(MalformedFileError, match="fewer bits"):
        Coder(data[:-2]).matrix((4, 4), None, mixed=False)
    with pytest.raises(MalformedFileError, match="cannot have written"):
        Coder(b"\x02" + b"\xff" * 8).numbers(9, None)
