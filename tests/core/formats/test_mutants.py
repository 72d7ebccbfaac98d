"""Thousands of damaged files: each is read, or refused with a remedy, and none hangs."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec

import numpy as np
import pytest
from format_mutants import mutant
from format_samples import (
    FACES,
    N_FRAMES,
    VERTICES,
    VTK_WRITERS,
    all_files,
    frame_zip,
    ply_binary,
    pvd,
    sequence,
    zipped,
)

from modalmotion.errors import InputError
from modalmotion.formats import ParserProcess, ReadLimits, read_sequence
from modalmotion.mesh.hdf5 import sequence_to_hdf5

LIMITS = ReadLimits(frames=1000, vertices=100_000, faces=100_000, decompressed_bytes=20_000_000)
# Times 22 files with VTK, 18 without it.
SHORT, LONG = 40, 1200
LONGEST_SECONDS = 30.0


@cache
def files() -> dict[str, bytes]:
    listed = pvd([(float(i), f"{i}.ply") for i in range(N_FRAMES)])
    made = all_files() | {
        "hdf5": sequence_to_hdf5(sequence(unit="mm")),
        "pvd zip": zipped(
            {f"{i}.ply": ply_binary(VERTICES[i]) for i in range(N_FRAMES)} | {"x.pvd": listed}
        ),
        "polygons zip": frame_zip(lambda p: ply_binary(p, [*FACES, [0, 1, 2, 3]]), "ply"),
    }
    if find_spec("vtkmodules") is not None:
        for name, (suffix, write) in VTK_WRITERS.items():
            made |= {name: write(VERTICES[0]), f"{name} zip": frame_zip(write, suffix)}
    return made


NAMES = sorted(files())


@pytest.fixture(scope="module")
def parser() -> Iterator[ParserProcess]:
    with ParserProcess(LIMITS, seconds=LONGEST_SECONDS) as process:
        yield process


def require_harmless(name: str, data: bytes, parser: ParserProcess) -> bool:
    started = time.monotonic()
    read, refusal = None, None
    try:
        read = read_sequence(data, parser=parser)
    except InputError as error:
        refusal = error
    assert time.monotonic() - started < LONGEST_SECONDS + 5
    if read is None:
        assert refusal is not None
        assert refusal.message
        assert refusal.remedy
        return False
    # What is let through is a sequence, whatever else it is.
    assert np.isfinite(read.sequence.vertices).all()
    assert read.sequence.faces.max(initial=0) < read.sequence.n_vertices
    return True


@pytest.mark.parametrize("name", NAMES)
def test_a_damaged_file_is_refused_or_harmless(name: str, parser: ParserProcess) -> None:
    data = files()[name]
    assert require_harmless(name, data, parser)
    refused = [not require_harmless(name, mutant(name, data, i), parser) for i in range(SHORT)]
    assert sum(refused) > SHORT // 3
    assert require_harmless(name, data, parser)


@pytest.mark.soak
@pytest.mark.parametrize("name", NAMES)
def test_many_damaged_files_are_refused_or_harmless(name: str, parser: ParserProcess) -> None:
    data = files()[name]
    for i in range(SHORT, SHORT + LONG):
        require_harmless(name, mutant(name, data, i), parser)
    assert require_harmless(name, data, parser)


def test_the_long_form_is_long_enough() -> None:
    assert len(NAMES) * LONG >= 20_000
