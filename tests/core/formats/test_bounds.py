"""Files that declare or unfold to more than they hold: refused in little memory."""

from __future__ import annotations

import io
import subprocess
import sys
import zipfile
from collections.abc import Callable
from typing import Any

import h5py
import numpy as np
import pytest
from format_samples import (
    VERTICES,
    animation,
    edited_glb,
    obj,
    off,
    ply_header,
    sequence,
    vtk_text,
    vtp_text,
    zipped,
)
from project import ROOT

from modalmotion.formats import write_glb, write_npz, write_vtkhdf

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs Linux's memory limits")

MEGABYTES = 400


def zip_bomb() -> bytes:
    # A thousand members of ten megabytes of zeros: ten gigabytes in ten megabytes.
    content = bytes(10_000_000)
    return zipped({f"{i}.obj": content for i in range(3)}).replace(
        len(content).to_bytes(4, "little"), (4 * 10**9).to_bytes(4, "little")
    )


def lying_zip_bomb() -> bytes:
    # Declares one byte a member and unfolds to a hundred megabytes.
    content = bytes(100_000_000)
    return zipped({"0.obj": content}).replace(
        len(content).to_bytes(4, "little"), (1).to_bytes(4, "little")
    )


def many_members() -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for i in range(45_000):
            archive.writestr(zipfile.ZipInfo(f"{i}.obj"), b"")
    return buffer.getvalue()


def npz_bomb() -> bytes:
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (100, 1000000, 3), }\n"
    member = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
    return zipped({"vertices.npy": member + bytes(1000)})


def hdf5(edit: Callable[[h5py.File], object]) -> bytes:
    buffer = io.BytesIO(write_vtkhdf(sequence()))
    with h5py.File(buffer, "r+") as file:
        edit(file)
    return buffer.getvalue()


def unwritten(file: h5py.File) -> None:
    del file["VTKHDF/Points"]
    file["VTKHDF"].create_dataset("Points", (10**9, 3), "f8", chunks=(1000, 3))


def repeated(file: h5py.File) -> None:
    # Ten thousand steps that all name the same points.
    n = 10**4
    steps = file["VTKHDF/Steps"]
    steps.attrs["NSteps"] = n
    for name in ("Values", "PointOffsets", "PartOffsets", "NumberOfParts"):
        del steps[name]
    for name in ("CellOffsets", "ConnectivityIdOffsets"):
        del steps[name]
        steps[name] = np.zeros((n, 4), int)
    steps["Values"] = np.arange(n, dtype=float)
    steps["PointOffsets"] = steps["PartOffsets"] = np.zeros(n, int)
    steps["NumberOfParts"] = np.ones(n, int)
    for name in ("VTKHDF/Points", "VTKHDF/NumberOfPoints"):
        del file[name]
    file["VTKHDF"].create_dataset("Points", data=np.zeros((100_000, 3)), compression="gzip")
    file["VTKHDF/NumberOfPoints"] = [100_000]


def declares(key: str, value: Any) -> bytes:
    def edit(document: dict[str, Any]) -> None:
        for accessor in document["accessors"]:
            accessor[key] = value
            del accessor["bufferView"]

    return edited_glb(write_glb(animation()), edit)


def deep_json() -> bytes:
    data = b"[" * 1_000_000
    header = b"glTF" + (2).to_bytes(4, "little") + (20 + len(data)).to_bytes(4, "little")
    return header + len(data).to_bytes(4, "little") + b"JSON" + data


BOMBS: dict[str, Callable[[], bytes]] = {
    "npz": npz_bomb,
    "zip": zip_bomb,
    "zip that lies": lying_zip_bomb,
    "zip of many members": many_members,
    "hdf5 without chunks": lambda: hdf5(unwritten),
    "hdf5 steps": lambda: hdf5(repeated),
    "glb": lambda: declares("count", 10**9),
    "glb of few": lambda: declares("count", 80_000_000),
    "glb of brackets": deep_json,
    "ply": lambda: ply_header("binary_little_endian", 10**9, 10**9) + bytes(100),
    "ply without properties": lambda: (
        b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
        b"property float x\nproperty float y\nproperty float z\nelement e 1999999\nend_header\n"
        + bytes(12)
    ),
    "ply of long lists": lambda: (
        ply_header("binary_little_endian", 0, 1)
        .replace(b"uchar int", b"uint int")
        .replace(b"property float quality\n", b"")
        + b"\xff" * 100
    ),
    "off": lambda: b"OFF\n1000000000 1000000000 0\n0 0 0\n",
    "stl": lambda: bytes(80) + b"\xff\xff\xff\xff" + bytes(100),
    "obj of one line": lambda: obj(VERTICES[0]) + b"v " + b"1 " * 30_000_000,
    "obj of one word": lambda: b"v " + b"1" * 60_000_000,
    "off of one line": lambda: off(VERTICES[0]) + b"3 " + b"1 " * 30_000_000,
    "raw noise": lambda: b"\x01" * 60_000_000,
}


VTK_BOMBS: dict[str, Callable[[], bytes]] = {
    "vtk": lambda: vtk_text(VERTICES[0]).replace(b"POINTS 12", b"POINTS 2000000"),
    "vtk polygons": lambda: vtk_text(VERTICES[0]).replace(b"12 48", b"12 4000000000"),
    "vtp": lambda: vtp_text(VERTICES[0]).replace(b'Points="12"', b'Points="2000000"'),
    "vtp polygons": lambda: vtp_text(VERTICES[0]).replace(b'Polys="12"', b'Polys="4000000"'),
}
HONEST = "an honest file"


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[str, float]]:
    """What became of each file, and after how many seconds."""
    folder = tmp_path_factory.mktemp("bombs")
    files = {name: make() for name, make in (BOMBS | VTK_BOMBS).items()}
    files[HONEST] = write_npz(sequence())
    for name, data in files.items():
        (folder / name).write_bytes(data)
    program = ROOT / "tests" / "support" / "formats_in_bounds.py"
    run = subprocess.run(
        [sys.executable, str(program), str(MEGABYTES), *(str(folder / name) for name in files)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr[-2000:]
    rows = [line.split("\t") for line in run.stdout.splitlines()]
    return {name: (outcome, float(seconds)) for name, outcome, seconds in rows}


@pytest.mark.parametrize("name", [*BOMBS, *VTK_BOMBS])
def test_a_bomb_is_refused_in_little_memory_and_time(
    name: str, outcomes: dict[str, tuple[str, float]]
) -> None:
    outcome, seconds = outcomes[name]
    assert outcome in ("LimitError", "MalformedFileError", "ParameterError")
    assert seconds < 60


def test_a_file_after_them_is_read(outcomes: dict[str, tuple[str, float]]) -> None:
    assert outcomes[HONEST][0].startswith("MeshSequence(n_frames=3,")
