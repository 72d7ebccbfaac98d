from __future__ import annotations

import io
import tracemalloc
import zipfile
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from modalmotion.errors import InputError, LimitError, MalformedFileError, ShapeError
from modalmotion.formats import ReadLimits, read_npz, write_npz
from modalmotion.mesh.sequence import mesh_sequence

VERTICES = np.arange(2 * 8 * 3, dtype=np.float32).reshape(2, 8, 3)


def npz(**arrays: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def full_file() -> bytes:
    return npz(
        vertices=VERTICES,
        faces=np.array([[0, 1, 2]], dtype=np.int32),
        grid=np.array([2, 4]),
        topology=np.array("cup"),
        times=np.array([0.0, 0.04]),
        unit=np.array("mm"),
        comment=np.array("anything"),
    )


def test_everything_in_the_contract_is_read() -> None:
    read = read_npz(full_file())
    sequence = read.sequence
    assert np.array_equal(sequence.vertices, VERTICES)
    assert sequence.faces.tolist() == [[0, 1, 2]]
    assert sequence.grid == (2, 4)
    assert sequence.topology is not None
    assert sequence.topology.name == "cup"
    assert sequence.times is not None
    assert sequence.times.tolist() == [0.0, 0.04]
    assert sequence.unit == "mm"
    assert read.ignored == ("comment",)


def test_times_in_milliseconds_become_seconds() -> None:
    times = read_npz(npz(vertices=VERTICES, times_ms=[0, 40])).sequence.times
    assert times is not None
    assert times.tolist() == [0.0, 0.04]


def test_a_compressed_file_in_fortran_order_reads_alike() -> None:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, vertices=np.asfortranarray(VERTICES))
    assert read_npz(buffer.getvalue()).sequence.id == mesh_sequence(VERTICES).id


@given(
    n_frames=st.integers(1, 3),
    n_vertices=st.integers(1, 5),
    single=st.booleans(),
    timed=st.booleans(),
    unit=st.sampled_from([None, "mm", "m"]),
)
def test_what_is_written_reads_back_with_the_same_id(
    n_frames: int, n_vertices: int, single: bool, timed: bool, unit: str | None
) -> None:
    positions = np.random.default_rng(1).normal(size=(n_frames, n_vertices, 3))
    sequence = mesh_sequence(
        positions.astype(np.float32) if single else positions,
        times=np.arange(n_frames) if timed else None,
        unit=unit,
        topology="open curve",
    )
    assert read_npz(write_npz(sequence)).sequence.id == sequence.id


@pytest.mark.parametrize(
    ("data", "error", "words"),
    [
        (b"", MalformedFileError, "empty"),
        (b"vertices: 1 2 3", MalformedFileError, "not a readable .npz"),
        (full_file()[: len(full_file()) // 2], MalformedFileError, "cut short"),
        (npz(points=VERTICES), MalformedFileError, "'points'"),
        (npz(vertices=np.array([{}, None], dtype=object)), MalformedFileError, "pickled"),
        (npz(vertices=np.full((1, 1, 3), "x")), ShapeError, "not understood"),
        (npz(vertices=VERTICES, unit=np.array(["mm", "m"])), ShapeError, "not one text"),
        (npz(vertices=VERTICES, topology=np.array(3)), ShapeError, "not one text"),
        (npz(vertices=VERTICES, times=[0, 1], times_ms=[0, 1]), ShapeError, "both"),
        (npz(vertices=VERTICES[0]), ShapeError, "(8, 3)"),
    ],
)
def test_a_file_that_is_none_says_what_is_wrong(
    data: bytes, error: type[InputError], words: str
) -> None:
    with pytest.raises(error) as caught:
        read_npz(data)
    assert words in str(caught.value)
    assert caught.value.remedy


def declared(shape: str, dtype: str = "<f4") -> bytes:
    """An archive whose vertices declare any shape and hold twelve bytes."""
    header = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    member = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(12)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("vertices.npy", member)
    return buffer.getvalue()


@pytest.mark.parametrize(
    "shape",
    [
        *("(1000000000, 3)", "(1, 999999999999999999, 3)", "(-1, 1, 3)", "(2, 1, 3)", "()", "1"),
        *("(1,", "-" * 9000 + "1"),
    ],
)
def test_declared_and_actual_sizes_must_agree(shape: str) -> None:
    with pytest.raises(MalformedFileError):
        read_npz(declared(shape))


def test_letters_that_are_none_are_refused() -> None:
    letter = np.frombuffer(b"\xff\xff\xff\x7f", "<U1")
    with pytest.raises(MalformedFileError, match="unit"):
        read_npz(npz(vertices=VERTICES, unit=letter))


def test_the_header_is_never_evaluated() -> None:
    with pytest.raises(MalformedFileError):
        read_npz(declared("(__import__('os').getpid(),)"))


@pytest.mark.parametrize(
    ("limits", "name"),
    [
        (ReadLimits(frames=1), "frames"),
        (ReadLimits(vertices=7), "vertices"),
        (ReadLimits(faces=0), "faces"),
        (ReadLimits(decompressed_bytes=100), "decompressed_bytes"),
    ],
)
def test_each_limit_is_named_by_its_error(limits: ReadLimits, name: str) -> None:
    with pytest.raises(LimitError) as caught:
        read_npz(full_file(), limits)
    assert caught.value.limit == name


def test_a_bomb_is_refused_by_what_it_declares() -> None:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, vertices=np.zeros((4, 100_000, 3)))
    assert len(buffer.getvalue()) < 20_000
    with pytest.raises(LimitError):
        read_npz(buffer.getvalue(), ReadLimits(decompressed_bytes=1_000_000))


def test_a_header_is_read_no_further_than_headers_go() -> None:
    buffer, n = io.BytesIO(), 50_000_000
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("vertices.npy", b"\x93NUMPY\x02\x00" + n.to_bytes(4, "little") + b" " * n)
    tracemalloc.start()
    try:
        with pytest.raises(MalformedFileError):
            read_npz(buffer.getvalue())
        assert tracemalloc.get_traced_memory()[1] < n // 10
    finally:
        tracemalloc.stop()


def test_a_name_twice_is_refused() -> None:
    buffer = io.BytesIO(npz(vertices=VERTICES))
    with (
        pytest.warns(UserWarning, match="Duplicate name"),
        zipfile.ZipFile(buffer, "a") as archive,
    ):
        archive.writestr("vertices.npy", b"other")
    with pytest.raises(MalformedFileError, match="twice"):
        read_npz(buffer.getvalue())


@settings(max_examples=80)
@given(st.data())
def test_damage_is_refused_or_harmless(data: st.DataObject) -> None:
    good = full_file()
    damaged = bytearray(good)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(damaged) - 1))
        damaged[at] = data.draw(st.integers(0, 255))
    try:
        sequence = read_npz(bytes(damaged), ReadLimits(decompressed_bytes=10_000)).sequence
    except InputError:
        return
    # zip guards the arrays' bytes with a checksum; what reads must hold the same positions.
    assert np.array_equal(sequence.vertices, VERTICES)
