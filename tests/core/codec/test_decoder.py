"""Bytes that are not a whole stream of ours are refused, and never give other vertices."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from codec_sequences import (
    KINDS,
    Make,
    jointed,
    lattice_sequence,
    mesh_of_tube,
)

from modalmotion.codec import decode, encode
from modalmotion.codec.coder import find_guards, read_varint, write_varint
from modalmotion.codec.spatial_modes import read_modes
from modalmotion.errors import LimitError, MalformedFileError
from modalmotion.limits import NO_LIMITS, ReadLimits

STEPS = pytest.mark.parametrize("step", [4, pytest.param(1, marks=pytest.mark.soak)])


def places(length: int, step: int) -> list[int]:
    """Every place of the header, every so many behind it, and the last one."""
    return sorted({*range(min(64, length)), *range(0, length, step), length - 1})


@STEPS
@pytest.mark.parametrize("make", KINDS)
def test_any_flipped_bit_is_refused(make: Make, step: int, rng: np.random.Generator) -> None:
    data = encode(make(rng), rms=0.3).data
    for place in places(len(data), step):
        damaged = bytearray(data)
        damaged[place] ^= 1 << int(rng.integers(8))
        with pytest.raises((MalformedFileError, LimitError)):
            decode(bytes(damaged))


@STEPS
@pytest.mark.parametrize("make", KINDS)
def test_any_cut_and_any_addition_are_refused(
    make: Make, step: int, rng: np.random.Generator
) -> None:
    data = encode(make(rng), rms=0.3).data
    for length in places(len(data), step):
        with pytest.raises(MalformedFileError):
            decode(data[:length])
    with pytest.raises(MalformedFileError, match="follow the end"):
        decode(data + b"\x00")


def sections(data: bytes) -> list[bytes]:
    found, position = [], 5
    while position < len(data):
        length, position = read_varint(data, position)
        found.append(data[position : position + length])
        position += length + 4
    return found


def rebuilt(parts: list[bytes]) -> bytes:
    """A stream whose checksums are right whatever it says."""
    data = b"MMSQ\x01"
    for part in parts:
        data += write_varint(len(part)) + part + struct.pack("<I", zlib.crc32(part))
    return data


@pytest.mark.every(2)
@STEPS
@pytest.mark.parametrize("make", KINDS)
def test_damage_behind_right_checksums_never_gives_other_vertices(
    make: Make, step: int, rng: np.random.Generator
) -> None:
    data = encode(make(rng), max_error=0.3).data
    original = decode(data).vertices
    parts = sections(data)
    limits = ReadLimits(frames=100, vertices=1000, faces=3000, decompressed_bytes=10_000_000)
    for _ in range(len(data) // step):
        which = int(rng.integers(len(parts)))
        part = bytearray(parts[which])
        if not part:
            continue
        for _ in range(int(rng.integers(1, 4))):
            part[int(rng.integers(len(part)))] = int(rng.integers(256))
        hostile = rebuilt([*parts[:which], bytes(part), *parts[which + 1 :]])
        try:
            found = decode(hostile, limits=limits).vertices
        except (MalformedFileError, LimitError, ValueError):
            continue
        assert np.array_equal(found, original)


def test_headers_that_declare_too_much_are_refused_at_once(rng: np.random.Generator) -> None:
    parts = sections(encode(lattice_sequence(rng), rms=0.3).data)
    _, after_frames = read_varint(parts[0], 0)
    _, after_vertices = read_varint(parts[0], after_frames)
    huge = write_varint(9) + write_varint(10**9) + parts[0][after_vertices:]
    with pytest.raises(LimitError) as refused:
        decode(rebuilt([huge, *parts[1:]]))
    assert refused.value.limit == "vertices"
    many = write_varint(10_000) + write_varint(1_000_000) + parts[0][after_vertices:]
    with pytest.raises(LimitError) as refused:
        decode(rebuilt([many, *parts[1:]]))
    assert refused.value.limit == "decompressed_bytes"


def test_blocks_and_patches_that_cost_too_much_are_refused(rng: np.random.Generator) -> None:
    parts = sections(encode(mesh_of_tube(rng), rms=0.3).data)
    header = parts[0]
    # Nine frames in one block: of a mesh that would need 2^27 coordinates and more for them.
    _, after_frames = read_varint(header, 0)
    _, after_vertices = read_varint(header, after_frames)
    many = header[:after_frames] + write_varint(6_000_000) + header[after_vertices:]
    with pytest.raises(LimitError) as refused:
        decode(rebuilt([many, *parts[1:]]), limits=NO_LIMITS)
    assert refused.value.limit == "block"
    with pytest.raises(LimitError) as refused:
        read_modes(b"\x02" + 2 * write_varint(5000) + bytes(1), 6000, np.zeros((0, 3), np.int64))
    assert refused.value.limit == "spring_modes"


def test_foreign_and_future_streams_are_refused_by_name(rng: np.random.Generator) -> None:
    data = encode(lattice_sequence(rng), rms=0.3).data
    with pytest.raises(MalformedFileError, match="not an encoded sequence"):
        decode(b"PK\x03\x04" + data)
    with pytest.raises(MalformedFileError, match="not an encoded sequence"):
        decode(b"")
    with pytest.raises(MalformedFileError, match="version 11"):
        decode(data[:4] + b"\x0b" + data[5:])


def test_a_decoder_that_computes_differently_is_refused(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    from modalmotion.codec.block import Block

    data = encode(lattice_sequence(rng), rms=0.3).data
    scaled = Block.scaled
    monkeypatch.setattr(Block, "scaled", lambda block, modes: scaled(block, modes) + 0.5)
    with pytest.raises(MalformedFileError, match="not those that were encoded"):
        decode(data)


@pytest.mark.parametrize("axes", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
def test_guards_decide_whatever_the_order_in_memory(
    axes: tuple[int, ...], rng: np.random.Generator
) -> None:
    scaled = np.floor(rng.uniform(-9, 9, size=(3, 4, 5))) + 0.5
    scaled = np.ascontiguousarray(scaled.transpose(axes)).transpose(np.argsort(axes))
    guards = find_guards(scaled + 1e-9, 1e-6)
    assert len(guards.places) == scaled.size
    assert np.array_equal(guards.round(scaled - 1e-9), np.ceil(scaled))


@pytest.mark.thorough
@pytest.mark.parametrize("other", ["Prescott", "Nehalem", "Haswell", "SkylakeX"])
def test_other_processors_decode_to_the_same(other: str, tmp_path: Path) -> None:
    """Processes of their own (2 s): the kernels of OpenBLAS for another processor encode."""
    code = """
import sys
import numpy as np
from codec_sequences import jointed, lattice_sequence, mesh_of_tube
from modalmotion.codec import encode
rng = np.random.default_rng(5)
sequences = [mesh_of_tube(rng, (20, 24)), lattice_sequence(rng, np.float64), jointed(rng)]
for i, effort in enumerate(["fast", "balanced"]):
    for j, sequence in enumerate(sequences):
        for k, rms in enumerate([0.1, 1e-3, 1e-5]):
            data = encode(sequence, rms=rms, effort=effort).data
            open(f"{sys.argv[1]}/{i}{j}{k}.mms", "wb").write(data)
"""
    path = os.pathsep.join(sys.path)
    environment = {**os.environ, "OPENBLAS_CORETYPE": other, "PYTHONPATH": path}
    command = [sys.executable, "-c", code, str(tmp_path)]
    subprocess.run(command, env=environment, check=True)
    streams = sorted(tmp_path.glob("*.mms"))
    assert len(streams) == 18
    for stream in streams:
        decode(stream.read_bytes())


def test_a_first_decode_loads_no_further_library(rng: np.random.Generator, tmp_path: Path) -> None:
    """A process of its own (0.5 s): what decoding loads is what makes the first one slow."""
    paths = []
    makes: tuple[Make, ...] = (lattice_sequence, mesh_of_tube, jointed)
    for number, make in enumerate(makes):
        paths.append(tmp_path / f"{number}.mms")
        paths[-1].write_bytes(encode(make(rng), rms=0.3).data)
    code = """
import sys
from pathlib import Path
from modalmotion.codec import decode
before = set(sys.modules)
for path in sys.argv[1:]:
    decode(Path(path).read_bytes())
print(sorted(name for name in set(sys.modules) - before if name.startswith(("scipy", "numpy"))))
"""
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, paths)], capture_output=True, text=True, check=True
    )
    assert done.stdout == "[]\n"
