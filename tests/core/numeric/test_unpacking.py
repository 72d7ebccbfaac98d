"""What is packed takes the memory that its header declares, however much more there is of it."""

from __future__ import annotations

import gzip
import io
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import Any

import h5py
import numpy as np
import pytest
from dicom_samples import slice_file
from format_samples import VERTICES, ply_binary, sequence, vtp_text, zipped
from project import ROOT

from modalmotion.errors import MalformedFileError
from modalmotion.formats import write_vtkhdf
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.numeric.unpacking import unpacked, unpacked_head

# With little effort: what is read again is the same.
PACK: dict[Any, Callable[[bytes], bytes]] = {
    "gzip": partial(gzip.compress, compresslevel=1),
    "zlib": partial(zlib.compress, level=1),
}
PLAIN = np.random.default_rng(0).integers(0, 9, 3_000_000, np.uint8).tobytes()

# Of images and meshes: many times what any reader needs for itself.
N = 100_000_000
N_FRAMES = 208
SIDES = (5000, 10_000, 2)
BOMB = 120_000_000


@pytest.mark.parametrize("packing", PACK)
def test_what_is_packed_comes_back(packing: Any) -> None:
    packed = b"head" + PACK[packing](PLAIN)
    assert unpacked(packed, packing, len(PLAIN), 4).tobytes() == PLAIN
    assert unpacked_head(packed, packing, 1000, 4) == PLAIN[:1000]
    assert unpacked_head(packed, packing, 1 << 30, 4) == PLAIN


@pytest.mark.parametrize("packing", PACK)
@pytest.mark.parametrize("n", [0, 1, len(PLAIN) - 1, len(PLAIN) + 1])
def test_another_size_than_declared_is_refused_and_both_are_named(packing: Any, n: int) -> None:
    packed = PACK[packing](PLAIN)
    with pytest.raises(MalformedFileError, match=f"declares {n} bytes.* {len(packed)} packed"):
        unpacked(packed, packing, n)
    with pytest.raises(MalformedFileError):
        unpacked(packed[: len(packed) // 2], packing, len(PLAIN))
    damaged = bytearray(packed)
    damaged[len(packed) // 3 : len(packed) // 2] = bytes(len(packed) // 2 - len(packed) // 3)
    with pytest.raises(MalformedFileError):
        unpacked(bytes(damaged), packing, len(PLAIN))


def test_members_of_gzip_follow_one_another_wherever_they_begin() -> None:
    # Around the end of a piece of 64 KiB, the two letters of the next one apart.
    for n in range(65_500, 65_560):
        stored = gzip.compress(PLAIN[:n], 0) + gzip.compress(b"end")
        assert unpacked(stored, "gzip", n + 3).tobytes() == PLAIN[:n] + b"end"


def nrrd_head(encoding: str, *sizes: int) -> bytes:
    return (
        f"NRRD0004\ntype: uchar\ndimension: 3\nsizes: {' '.join(map(str, sizes))}\n"
        f"spacings: 1 1 1\nencoding: {encoding}\n\n"
    ).encode()


def metaimage_head(*sizes: int) -> bytes:
    return (
        f"ObjectType = Image\nNDims = 3\nDimSize = {' '.join(map(str, sizes))}\n"
        "CompressedData = True\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
    ).encode()


def nifti_head(*sizes: int) -> bytes:
    import nibabel

    header = nibabel.Nifti1Header()
    header.set_data_dtype(np.uint8)
    header.set_data_shape(sizes)
    header["vox_offset"], header["magic"] = 352, b"n+1"
    return bytes(header.binaryblock) + bytes(4)


def deflated_dicom(rows: int, columns: int, n: int) -> bytes:
    """Declare pixels of 16 bits, and hold n bytes of them."""
    import pydicom

    plain = slice_file(np.zeros((2, 2)), z=0.0, trigger=0.0)
    own = pydicom.dcmread(io.BytesIO(plain))
    own.Rows, own.Columns = rows, columns
    own.PixelData = bytes(n)
    own.file_meta.TransferSyntaxUID = pydicom.uid.DeflatedExplicitVRLittleEndian
    out = io.BytesIO()
    own.save_as(out, enforce_file_format=True)
    return out.getvalue()


def moving(n_frames: int) -> Any:
    """Half a megabyte a frame, packed to a thirtieth of it."""
    values = np.random.default_rng(1).integers(-4096, 4096, (n_frames, 5000, 1), np.int16)
    vertices = np.repeat(values, 24, axis=2).reshape(n_frames, 40_000, 3) / np.float32(64)
    return mesh_sequence(vertices, np.array([[0, 1, 2]]))


def npz() -> bytes:
    member, buffer = io.BytesIO(), io.BytesIO()
    np.save(member, moving(N_FRAMES).vertices)
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file:
        file.writestr("vertices.npy", member.getbuffer())
    return buffer.getvalue()


def lying_npz() -> bytes:
    """A header of a small array, and behind it zeros without end."""
    member = io.BytesIO()
    np.save(member, VERTICES)
    size = member.tell()
    data = zipped({"vertices.npy": member.getvalue() + bytes(BOMB)})
    return data.replace((size + BOMB).to_bytes(4, "little"), size.to_bytes(4, "little"))


def frames() -> bytes:
    own = moving(60)
    return zipped({f"{k}.ply": ply_binary(own.vertices[k]) for k in range(own.n_frames)})


def lying_zip() -> bytes:
    plain = ply_binary(VERTICES[0])
    data = zipped({"0.ply": plain + bytes(BOMB)})
    return data.replace((len(plain) + BOMB).to_bytes(4, "little"), len(plain).to_bytes(4, "little"))


def vtkhdf(n_frames: int) -> bytes:
    buffer = io.BytesIO(write_vtkhdf(moving(n_frames)))
    with h5py.File(buffer, "r+") as file:
        points = file["VTKHDF/Points"][()]
        del file["VTKHDF/Points"]
        file["VTKHDF"].create_dataset(
            "Points",
            data=points,
            chunks=(40_000, 3),
            compression="gzip",
            compression_opts=1,
            shuffle=True,
        )
        # Without the room that the points had before.
        packed = io.BytesIO()
        with h5py.File(packed, "w") as compact:
            for name in file:
                file.copy(name, compact)
    return packed.getvalue()


def lying_vtkhdf() -> bytes:
    """A chunk that unpacks to more than a chunk, which the library's filter follows."""
    buffer = io.BytesIO(write_vtkhdf(sequence()))
    with h5py.File(buffer, "r+") as file:
        points = file["VTKHDF/Points"][()]
        del file["VTKHDF/Points"]
        made = file["VTKHDF"].create_dataset(
            "Points", data=points, chunks=points.shape, compression="gzip"
        )
        made.id.write_direct_chunk((0, 0), zlib.compress(points.tobytes() + bytes(BOMB)))
    return buffer.getvalue()


def vtp(n_blocks: int, block: int, last: int) -> bytes:
    """Points in compressed blocks, as their head declares them."""
    points = VERTICES[0].tobytes()
    packed = zlib.compress(points)
    head = struct.pack("<4Q", n_blocks, block, last, len(packed))
    plain = vtp_text(VERTICES[0])
    start = plain.index(b"<DataArray")
    end = plain.index(b"</DataArray>") + len(b"</DataArray>")
    array = (
        b'<DataArray type="Float32" Name="Points" NumberOfComponents="3" format="appended" '
        b'offset="0"/>'
    )
    return (
        (plain[:start] + array + plain[end:])
        .replace(b" header_type", b' compressor="vtkZLibDataCompressor" header_type')
        .replace(b"</VTKFile>", b'<AppendedData encoding="raw">_' + head + packed)
    ) + b"</AppendedData></VTKFile>"


POINT_BYTES = VERTICES[0].nbytes

IMAGES: dict[str, tuple[int, Callable[[], bytes]]] = {
    "metaimage": (N, lambda: metaimage_head(*SIDES) + zlib.compress(bytes(N), 1)),
    "metaimage with more": (8, lambda: metaimage_head(2, 2, 2) + zlib.compress(bytes(BOMB), 1)),
    "nrrd gzip": (N, lambda: nrrd_head("gzip", *SIDES) + gzip.compress(bytes(N), 1)),
    "nrrd gzip with more": (8, lambda: nrrd_head("gzip", 2, 2, 2) + gzip.compress(bytes(BOMB), 1)),
    "nifti": (N, lambda: gzip.compress(nifti_head(*SIDES) + bytes(N), 1)),
    "nifti with more": (8, lambda: gzip.compress(nifti_head(2, 2, 2) + bytes(BOMB), 1)),
    "dicom deflated": (8, lambda: deflated_dicom(2, 2, BOMB)),
}
MESHES: dict[str, tuple[int, Callable[[], bytes]]] = {
    "npz": (N_FRAMES * 480_000, npz),
    "npz with more": (VERTICES.nbytes, lying_npz),
    "zip": (60 * 480_000, frames),
    "zip with more": (VERTICES.nbytes, lying_zip),
    "vtkhdf": (N_FRAMES * 480_000, lambda: vtkhdf(N_FRAMES)),
    "vtkhdf with more": (VERTICES.nbytes, lying_vtkhdf),
    "vtp": (POINT_BYTES, lambda: vtp(1, POINT_BYTES, 0)),
    "vtp of many blocks": (POINT_BYTES, lambda: vtp(300_000_000, POINT_BYTES, 0)),
    "vtp of a large block": (POINT_BYTES, lambda: vtp(1, BOMB, 0)),
    "vtp of a large last block": (POINT_BYTES, lambda: vtp(1, POINT_BYTES, BOMB)),
}
HONEST = {"metaimage", "nrrd gzip", "nifti", "npz", "zip", "vtkhdf", "vtp"}
PACKAGES = {"nrrd": "nrrd", "nifti": "nibabel", "dicom": "pydicom"}
ROWS = {
    name: row
    for name, row in (IMAGES | MESHES).items()
    if find_spec(PACKAGES.get(name.split()[0], "numpy")) is not None
}


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, str, int]]:
    """Bytes sent, how reading them ended, and by how many bytes the process grew at its peak."""
    folder = tmp_path_factory.mktemp("packed")
    paths = {name: folder / name for name in ROWS}
    for name, (_, make) in ROWS.items():
        paths[name].write_bytes(make())
    program = ROOT / "tests" / "support" / "peak_memory.py"
    run = subprocess.run(
        [sys.executable, str(program), *map(str, paths.values())],
        capture_output=True,
        text=True,
        timeout=250,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr[-2000:]
    rows = {}
    for line in run.stdout.splitlines():
        name, said, peak = line.split("\t")
        sent = paths[name].stat().st_size
        rows[name] = sent, said, int(peak)
        print(f"{name:28} {sent:>12,} {ROWS[name][0]:>12,} {int(peak):>12,}  {said}")  # noqa: T201
    return rows


@pytest.mark.skipif(sys.platform != "linux", reason="counts memory as Linux does")
@pytest.mark.parametrize("name", ROWS)
def test_reading_takes_what_is_declared(name: str, table: dict[str, tuple[int, str, int]]) -> None:
    _, said, peak = table[name]
    assert (said == "read") is (name in HONEST)
    assert said in ("read", "MalformedFileError", "LimitError")
    assert peak <= 1.3 * ROWS[name][0] + 64_000_000
