"""The C sources of the codec: they compile, and code what the Python form codes."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from compile_library import compile_library, system_compiler
from pure_codec import pure

from modalmotion.codec.bits.entropy import Writer, code_numbers
from modalmotion.codec.bits.matrix import code_matrix

pytestmark = pytest.mark.skipif(system_compiler() is None, reason="there is no C compiler")


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    path = tmp_path_factory.mktemp("native") / "library"
    compile_library(path)
    return ctypes.CDLL(str(path))


def pointer(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def test_lists_and_matrices_have_the_bytes_of_python(
    compiled: ctypes.CDLL, rng: np.random.Generator
) -> None:
    numbers = np.floor(rng.exponential(30.0, 700)).astype(np.int64) ** 2
    matrix = np.floor(rng.standard_cauchy((13, 157))).astype(np.int64)
    matrix[:, 90:] = 0
    matrix[11:] = 0
    with pure():
        writer = Writer()
        code_numbers(writer, len(numbers), numbers)
        code_matrix(writer, matrix.shape, matrix)
        expected = writer.finish()
    state = np.zeros(12, dtype=np.int64)
    words, bits = np.zeros(4096, dtype=np.uint32), np.zeros(4096, dtype=np.uint8)
    room = np.zeros(1 << 20, dtype=np.uint8)
    state[4], state[6] = len(words), 8 * len(bits)
    coder = pointer(state), pointer(words), pointer(bits)
    compiled.mm_begin(*coder[:2], 0)
    sizes = tuple(map(ctypes.c_int64, matrix.shape))
    length = ctypes.c_int64(len(numbers))
    left = pointer(room), ctypes.c_int64(len(room))
    assert compiled.mm_list(*coder, length, pointer(numbers)) == 0
    assert compiled.mm_matrix(*coder, *sizes, pointer(matrix), *left) == 0
    assert compiled.mm_finish(*coder) == 0
    n_words, n_bytes = int(state[3]), -(-int(state[5]) // 8)
    written = words[:n_words].astype("<u4").tobytes() + bits[:n_bytes].tobytes()
    assert expected.endswith(written)
    assert len(expected) - len(written) <= 2
    assert not bits[n_bytes:].any()

    state[4], state[6] = n_words, 8 * n_bytes
    compiled.mm_begin(*coder[:2], 1)
    found, rows = np.zeros_like(numbers), np.zeros_like(matrix)
    assert compiled.mm_list(*coder, length, pointer(found)) == 0
    assert compiled.mm_matrix(*coder, *sizes, pointer(rows), *left) == 0
    assert np.array_equal(found, numbers)
    assert np.array_equal(rows, matrix)
