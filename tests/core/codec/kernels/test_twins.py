"""The compiled kernels against the same in Python: equal bytes, equal numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from codec_sequences import errors_of, random_sequence
from numpy.typing import NDArray
from pure_codec import compiled, pure

from modalmotion.codec import Effort, decode, encode
from modalmotion.codec.bits.entropy import Coder, Reader, Writer
from modalmotion.codec.bits.matrix import code_matrix
from modalmotion.codec.bits.mixed_matrix import code_mixed_matrix
from modalmotion.codec.connectivity.faces import read_faces, write_faces
from modalmotion.errors import MalformedFileError
from modalmotion.mesh import lattice_faces
from modalmotion.modes.topology import CYLINDER, TORUS

Ints = NDArray[np.int64]
Code = Callable[[Coder, tuple[int, int], Ints | None], Ints]

pytestmark = compiled


def matrix(rng: np.random.Generator, largest: float = 4.0) -> Ints:
    shape = int(rng.integers(1, 12)), int(rng.integers(1, 90))
    falls = np.exp(-np.arange(shape[0])[:, None] / 5 - np.arange(shape[1]) / rng.uniform(5, 90))
    values: Ints = np.rint(10 ** rng.uniform(-1, largest) * falls * rng.laplace(size=shape))
    return values.astype(np.int64)


def written(code: Code, values: Ints) -> bytes:
    writer = Writer()
    writer.symbols(np.ones((3, 5)), np.array([1, 2, 4]))
    code(writer, (values.shape[0], values.shape[1]), values)
    writer.bits(np.array([3]), np.array([5]))
    return writer.finish()


def read(code: Code, data: bytes, shape: tuple[int, int]) -> Ints:
    reader = Reader(data)
    assert reader.symbols(np.ones((3, 5))).tolist() == [1, 2, 4]
    values = code(reader, shape, None)
    assert reader.bits(np.array([3])).tolist() == [5]
    return values


@pytest.mark.parametrize("code", [code_matrix, code_mixed_matrix])
@pytest.mark.parametrize("largest", [2.0, 10.0])
def test_matrices_have_the_same_bytes(code: Code, largest: float, rng: np.random.Generator) -> None:
    for _ in range(4):
        values = matrix(rng, largest)
        with pure():
            data = written(code, values)
        assert written(code, values) == data
        assert np.array_equal(read(code, data, values.shape), values)
        with pure():
            assert np.array_equal(read(code, data, values.shape), values)


def any_faces(rng: np.random.Generator, kind: int) -> tuple[Ints, int]:
    """Triangles at random, rows in some order, a hub, and vertices that no triangle has."""
    rows = int(rng.integers(3, 7)), int(rng.integers(3, 9))
    n = int(np.prod(rows))
    if kind == 0:
        return rng.integers(0, n, size=(int(rng.integers(1, 60)), 3)), n
    if kind == 1:
        faces = lattice_faces(CYLINDER, rows)
        return rng.permutation(n + 2)[faces[rng.permutation(len(faces))]], n + 2
    if kind == 2:
        rim = np.arange(1, n + 18)
        return np.stack([np.zeros(len(rim), np.int64), rim, np.roll(rim, -1)], axis=1), n + 18
    return lattice_faces(TORUS, rows), n


@pytest.mark.parametrize("keep_order", [True, False])
@pytest.mark.parametrize("kind", range(4))
def test_faces_have_the_same_bytes(kind: int, keep_order: bool, rng: np.random.Generator) -> None:
    faces, n = any_faces(rng, kind)
    with pure():
        data = write_faces(n, None, faces, keep_order=keep_order)
        expected = read_faces(data, len(faces), n, None)
    assert write_faces(n, None, faces, keep_order=keep_order) == data
    assert np.array_equal(read_faces(data, len(faces), n, None), expected)


def test_a_table_that_is_too_small_grows(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    from modalmotion.codec.machine import memory

    faces, n = any_faces(rng, 1)
    data = write_faces(n, None, faces, keep_order=False)
    expected = read_faces(data, len(faces), n, None)
    monkeypatch.setattr(memory, "_MOST_AT_FIRST", 5)
    assert write_faces(n, None, faces, keep_order=False) == data
    assert np.array_equal(read_faces(data, len(faces), n, None), expected)


def test_a_writer_whose_room_is_too_small_grows(rng: np.random.Generator) -> None:
    values = rng.integers(-(2**35), 2**35, size=(20, 200))
    for code in (code_matrix, code_mixed_matrix):
        data = written(code, values)
        assert len(data) > 4 * 4 * 1024
        assert np.array_equal(read(code, data, values.shape), values)


@pytest.mark.parametrize("n_bytes", [0, 3, 40])
def test_damage_is_refused_in_the_same_words(n_bytes: int, rng: np.random.Generator) -> None:
    faces, n = any_faces(rng, 1)
    data = write_faces(n, None, faces, keep_order=False)
    for _ in range(12):
        hostile = data[:3] + rng.bytes(n_bytes)
        fast = answer(hostile, len(faces), n)
        with pure():
            assert answer(hostile, len(faces), n) == fast


def answer(data: bytes, n_faces: int, n: int) -> str:
    try:
        return str(read_faces(data, n_faces, n, None).tolist())
    except MalformedFileError as error:
        return str(error)


def require_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sequence = random_sequence(rng)
    effort = list(Effort)[seed % len(Effort)]
    share = 10.0 ** rng.uniform(-4.0, -0.5)
    bound = share * float(np.ptp(sequence.vertices, axis=(0, 1)).max())
    kind = "rms" if seed % 2 else "max_error"
    encoded = encode(sequence, effort=effort, **{kind: bound})
    decoded = decode(encoded.data)
    reached = errors_of(sequence, decoded)[kind == "max_error"]
    assert reached <= bound * (1 + 1e-12)
    with pure():
        assert encode(sequence, effort=effort, **{kind: bound}).data == encoded.data
        slowly = decode(encoded.data)
    assert np.array_equal(slowly.vertices, decoded.vertices)
    assert np.array_equal(slowly.faces, decoded.faces)


@pytest.mark.parametrize("seed", range(6))
def test_streams_have_the_same_bytes_and_keep_their_bound(seed: int) -> None:
    require_twin(seed)


@pytest.mark.soak
@pytest.mark.parametrize("block", range(20))
def test_two_thousand_streams_have_the_same_bytes_and_keep_their_bounds(block: int) -> None:
    for seed in range(100 * block, 100 * block + 100):
        require_twin(10_000 + seed)
