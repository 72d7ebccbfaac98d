"""Thousands of damaged files: each is read, or refused with a remedy, and none hangs or grows."""

from __future__ import annotations

import io
import os
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import h5py
import numpy as np
import pytest
from format_mutants import mutant
from format_samples import (
    FACES,
    N_FRAMES,
    N_VERTICES,
    TIMES,
    VERTICES,
    VTK_WRITERS,
    all_files,
    frame_zip,
    ply_binary,
    pvd,
    sequence,
    zipped,
)
from image_files import image_files

from modalmotion.errors import InputError
from modalmotion.formats import (
    Format,
    ParserProcess,
    ReadLimits,
    ReadOptions,
    read_sequence,
    write_vtkhdf,
)
from modalmotion.formats.volumes import read_images
from modalmotion.images import ImageSequence, PlaneSet, Volume
from modalmotion.mesh.sequence import MeshSequence, sequence_to_hdf5

LIMITS = ReadLimits(frames=1000, vertices=100_000, faces=100_000, decompressed_bytes=20_000_000)
# Of each reader, and there are some forty with all packages.
SHORT, LONG = 40, 3000
LONGEST_SECONDS = 30.0
# Beside what is declared.
SPARE_BYTES = 64_000_000

RAW = ReadOptions(limits=LIMITS, format=Format.RAW, n_vertices=N_VERTICES)


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
        made |= vtk_files()
    packed = io.BytesIO()
    np.savez_compressed(packed, vertices=VERTICES, faces=FACES, times=TIMES)
    made |= {"npz packed": packed.getvalue(), "vtkhdf packed": packed_vtkhdf()}
    return made | {"raw": VERTICES.tobytes()} | image_files()


def vtk_files() -> dict[str, bytes]:
    """Write surfaces as VTK itself does, in each of its ways."""
    from vtkmodules.vtkFiltersSources import vtkSphereSource
    from vtkmodules.vtkIOLegacy import vtkPolyDataWriter
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    sphere = vtkSphereSource()
    sphere.Update()
    made: dict[str, bytes] = {}
    with TemporaryDirectory() as folder:
        path = Path(folder) / "frame.vtk"
        legacy = vtkPolyDataWriter()
        legacy.SetInputData(sphere.GetOutput())
        legacy.SetFileName(str(path))
        legacy.SetFileVersion(42)
        for form in ("ASCII", "Binary"):
            getattr(legacy, f"SetFileTypeTo{form}")()
            legacy.Write()
            made[f"vtk {form}"] = path.read_bytes()
    for mode in ("Ascii", "Binary", "Appended"):
        for packing, is_text in (("None", False), ("ZLib", False), ("ZLib", True)):
            xml = vtkXMLPolyDataWriter()
            xml.SetInputData(sphere.GetOutput())
            xml.WriteToOutputStringOn()
            getattr(xml, f"SetDataModeTo{mode}")()
            getattr(xml, f"SetCompressorTypeTo{packing}")()
            xml.SetEncodeAppendedData(is_text)
            xml.Write()
            if mode == "Appended" or (not is_text and (mode, packing) != ("Ascii", "ZLib")):
                made[f"vtp {mode} {packing}{' base64' if is_text else ''}"] = as_bytes(
                    xml.GetOutputString()
                )
    return made


def as_bytes(text: Any) -> bytes:
    """Take what VTK gives as text or bytes, by what is in it."""
    return text.encode() if isinstance(text, str) else bytes(text)


def packed_vtkhdf() -> bytes:
    buffer = io.BytesIO(write_vtkhdf(sequence(times=TIMES)))
    with h5py.File(buffer, "r+") as file:
        points = file["VTKHDF/Points"][()]
        del file["VTKHDF/Points"]
        filters: dict[str, Any] = {"compression": "gzip", "shuffle": True, "fletcher32": True}
        file["VTKHDF"].create_dataset("Points", data=points, chunks=(12, 3), **filters)
    return buffer.getvalue()


IMAGES = set(image_files())
NAMES = sorted(files())


@pytest.fixture(scope="module")
def parser() -> Iterator[ParserProcess]:
    with ParserProcess(LIMITS, seconds=LONGEST_SECONDS) as process:
        yield process


def require_harmless(name: str, data: bytes, parser: ParserProcess) -> bool:
    started = time.monotonic()
    is_read, refusal = False, None
    try:
        if name in IMAGES:
            require_images(read_images(data, parser=parser))
        else:
            options = RAW if name == "raw" else ReadOptions(limits=LIMITS)
            require_sequence(read_sequence(data, options, parser=parser).sequence)
        is_read = True
    except InputError as error:
        refusal = error
    assert time.monotonic() - started < LONGEST_SECONDS + 5
    if refusal is not None:
        assert refusal.message
        assert refusal.remedy
    return is_read


def require_sequence(sequence: MeshSequence) -> None:
    # What is let through is a sequence, whatever else it is.
    assert np.isfinite(sequence.vertices).all()
    assert sequence.faces.max(initial=0) < sequence.n_vertices


def require_images(images: ImageSequence) -> None:
    for frame in images.frames:
        planes = frame.planes if isinstance(frame, PlaneSet) else [frame]
        assert all(np.isfinite(one.affine).all() for one in planes if isinstance(one, Volume))


class Peaks:
    """By how much a parser's process, and this one, grow at most from here on (Linux)."""

    def __init__(self, parser: ParserProcess) -> None:
        self.parser, self.highest = parser, 0
        self.start: dict[int, int] = {}

    def look(self) -> None:
        """Look again: a parser that ended has another one after it."""
        child = self.parser._child
        for pid in (os.getpid(), 0 if child is None else child.pid):
            # What was highest begins anew from what is there.
            with suppress(OSError):
                if pid and pid not in self.start:
                    Path(f"/proc/{pid}/clear_refs").write_text("5")
                words = Path(f"/proc/{pid}/status").read_text().split()
                peak = 1024 * int(words[words.index("VmHWM:") + 1])
                self.highest = max(self.highest, peak - self.start.setdefault(pid, peak))


def require_all_harmless(name: str, numbers: range, parser: ParserProcess) -> int:
    """Read mutants; how many were refused."""
    data, refused = files()[name], 0
    assert require_harmless(name, data, parser)
    peaks = Peaks(parser)
    for i in numbers:
        peaks.look()
        refused += not require_harmless(name, mutant(name, data, i), parser)
    peaks.look()
    assert require_harmless(name, data, parser)
    row = f"{len(numbers):>7} {len(numbers) - refused:>6} read {refused:>6} refused"
    print(f"{name:20} {row} {peaks.highest / 1e6:6.1f} MB")  # noqa: T201
    assert peaks.highest < 1.3 * LIMITS.decompressed_bytes + SPARE_BYTES
    return refused


@pytest.mark.parametrize("name", NAMES)
def test_a_damaged_file_is_refused_or_harmless(name: str, parser: ParserProcess) -> None:
    refused = require_all_harmless(name, range(SHORT), parser)
    # Any numbers are raw ones.
    assert refused > SHORT // 4 or name == "raw"


@pytest.mark.soak
@pytest.mark.parametrize("name", NAMES)
def test_many_damaged_files_are_refused_or_harmless(name: str, parser: ParserProcess) -> None:
    require_all_harmless(name, range(SHORT, SHORT + LONG), parser)


def test_the_long_form_is_long_enough() -> None:
    assert len(NAMES) * LONG >= 80_000
