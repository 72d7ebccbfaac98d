"""Files of images made in memory, as other programs write them."""

from __future__ import annotations

import gzip
import io
import zipfile
import zlib
from collections.abc import Callable
from importlib.util import find_spec

import numpy as np
from dicom_samples import slice_file
from format_samples import zipped

from modalmotion.formats.volumes.one_file import write_nifti
from modalmotion.images import ImageSequence, Volume


def metaimage(values: np.ndarray | None = None, spacing: str = "2 2 2 0.1") -> bytes:
    """Write a .mha of whole numbers along i, j, k and time; a small one by default."""
    if values is None:
        values = np.arange(4 * 3 * 2 * 2, dtype=np.uint8).reshape(4, 3, 2, 2)
    kind = {"u1": "MET_UCHAR", "i2": "MET_SHORT"}[values.dtype.str[1:]]
    head = (
        "ObjectType = Image\n"
        f"NDims = {values.ndim}\n"
        f"DimSize = {' '.join(map(str, values.shape))}\n"
        f"ElementSpacing = {' '.join(spacing.split()[: values.ndim])}\n"
        f"ElementType = {kind}\n"
        "ElementDataFile = LOCAL\n"
    )
    return head.encode() + values.tobytes(order="F")


def image_files() -> dict[str, bytes]:
    """Write a small file of each format whose package is there; names ending with zip are zips."""
    plain = metaimage()
    head, _, body = plain.partition(b"LOCAL\n")
    packed = head.replace(b"ElementType", b"CompressedData = True\nElementType")
    files = {"metaimage": plain, "metaimage zlib": packed + b"LOCAL\n" + zlib.compress(body)}
    if find_spec("nibabel") is not None:
        rng = np.random.default_rng(0)
        frames = [Volume(rng.integers(0, 99, (5, 4, 3), np.int16), np.eye(4)) for _ in range(2)]
        packed = write_nifti(ImageSequence(tuple(frames), np.array([0.0, 0.1])))
        files |= {"nifti gz": packed, "nifti": gzip.decompress(packed)}
    if find_spec("nrrd") is not None:
        files["nrrd"] = nrrd_file()
        head, _, body = files["nrrd"].partition(b"\n\n")
        own = head.replace(b"encoding: raw", b"encoding: gzip")
        files["nrrd gzip"] = own + b"\n\n" + gzip.compress(body)
    if find_spec("pydicom") is not None:
        slices = {
            f"{z}_{t}.dcm": slice_file(
                np.full((4, 3), z + t), z=6.0 * z, trigger=100.0 * t, number=2 * z + t
            )
            for z in range(3)
            for t in range(2)
        }
        files |= {"dicom": slices["0_0.dcm"], "dicom zip": zipped(slices, zipfile.ZIP_STORED)}
    return files


def deflated(data: bytes) -> bytes:
    """Write a DICOM file again, deflated behind its head."""
    import pydicom

    own = pydicom.dcmread(io.BytesIO(data))
    own.file_meta.TransferSyntaxUID = pydicom.uid.DeflatedExplicitVRLittleEndian
    out = io.BytesIO()
    own.save_as(out, enforce_file_format=True)
    return out.getvalue()


def repacked(name: str, data: bytes, damage: Callable[[bytes], bytes]) -> bytes:
    """Change what is packed behind the head of a file whose name ends with how it is."""
    forms: dict[str, tuple[Callable[[bytes], bytes], Callable[[bytes], bytes]]] = {
        "gz": (gzip.decompress, gzip.compress),
        "gzip": (gzip.decompress, gzip.compress),
        "zlib": (zlib.decompress, zlib.compress),
    }
    unpack, pack = forms[name.split()[-1]]
    mark = {"nrrd": b"\n\n", "metaimage": b"LOCAL\n", "nifti": b""}[name.split()[0]]
    start = data.index(mark) + len(mark)
    return data[:start] + pack(damage(unpack(data[start:])))


def nrrd_file() -> bytes:
    """Write a small .nrrd of raw numbers, with directions in space."""
    head = (
        "NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 4 3 2\n"
        "space directions: (1,0,0) (0,2,0) (0,0,3)\nendian: little\nencoding: raw\n"
        "space origin: (0,0,0)\n\n"
    )
    return head.encode() + np.arange(24, dtype="<i2").tobytes()
