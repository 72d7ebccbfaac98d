"""NIfTI, by nibabel: the sform over the qform, RAS turned to LPS once; read and written."""

from __future__ import annotations

import gzip
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError, ShapeError, needs_extra
from modalmotion.formats.frame_files import stored_zip
from modalmotion.formats.result import Parsed
from modalmotion.formats.volumes.stack import (
    RAS_TO_LPS,
    damaged,
    parsed,
    regular,
    samples,
    timed,
)
from modalmotion.images import ImageSequence, PlaneSet, Volume
from modalmotion.limits import ReadLimits
from modalmotion.notes import Note
from modalmotion.numeric.unpacking import unpacked_head

_MM: Final = {"mm": 1.0, "meter": 1e3, "micron": 1e-3, "unknown": 1.0}

# The longer header, of NIfTI-2.
_HEAD: Final = 540

_REMEDY: Final = "Write it again as one .nii or .nii.gz of a volume, or of volumes over time."


def parse_nifti(data: bytes, limits: ReadLimits) -> Parsed:
    """Read a .nii or .nii.gz from bytes.

    Raises
    ------
    MalformedFileError
        If it is no such image.
    """
    with needs_extra("images"):
        import nibabel
    is_packed = data[:2] == b"\x1f\x8b"
    head = unpacked_head(data, "gzip", _HEAD) if is_packed else data[:_HEAD]
    kind = nibabel.Nifti2Header if head[4:7] == b"n+2" else nibabel.Nifti1Header
    with damaged("The NIfTI file is damaged.", _REMEDY, "nibabel", "nibabel.global"):
        return _of(kind(head[: kind.template_dtype.itemsize]), data, limits, is_packed)


def _of(header: Any, data: bytes, limits: ReadLimits, is_packed: bool) -> Parsed:
    kind, shape = header.get_data_dtype(), header.get_data_shape()
    if kind.names or kind.kind not in "iuf":
        raise MalformedFileError("The voxels are colours or complex numbers.", remedy=_REMEDY)
    full = (*shape, 1, 1, 1, 1)[: max(4, len(shape))]
    if any(n != 1 for n in full[4:]):
        raise MalformedFileError(
            f"The NIfTI file has {len(shape)} axes: more than space and time.", remedy=_REMEDY
        )
    n_frames, offset = int(full[3]), int(header.get_data_offset())
    limits.require("frames", n_frames)
    slope, intercept = header.get_slope_inter()
    values = samples(
        *(data, kind, full[:4], limits),
        start=0 if is_packed else offset,
        packing="gzip" if is_packed else None,
        head=offset,
        scale=(1.0, 0.0) if slope is None else (float(slope), float(intercept)),
    )
    length, duration = header.get_xyzt_units()
    to_lps = RAS_TO_LPS * _MM.get(length, 1.0)
    affine = to_lps @ np.asarray(header.get_best_affine(), dtype=np.float64)[:3]
    notes: list[Note] = []
    if not int(header["sform_code"]) and not int(header["qform_code"]):
        notes.append(Note.of("nifti_position_unknown"))
    zooms = header.get_zooms()
    interval = float(zooms[3]) if len(zooms) > 3 else 0.0
    times = timed(regular(interval, n_frames), duration, "NIfTI", notes)
    return parsed(np.moveaxis(values, 3, 0), affine, times, notes)


def write_nifti(images: ImageSequence) -> bytes:
    """Write volumes over time as one .nii.gz.

    Raises
    ------
    ShapeError
        If a frame is missing or is no volume, or volumes differ in place.
    """
    volumes = [frame for frame in images.frames if isinstance(frame, Volume)]
    if len(volumes) < images.n_frames or any(
        v.shape != volumes[0].shape or not np.allclose(v.affine, volumes[0].affine) for v in volumes
    ):
        raise ShapeError(
            "The frames are not volumes in one place, as NIfTI requires.",
            remedy="Write planes with write_nifti_zip, and other volumes one by one.",
        )
    return _nifti([volume.values for volume in volumes], volumes[0].affine, images)


def write_nifti_zip(images: ImageSequence) -> bytes:
    """Write images as a zip: one .nii.gz of volumes, or one for each plane of a set."""
    first = next(frame for frame in images.frames if frame is not None)
    files = {}
    if isinstance(first, PlaneSet):
        for p, plane in enumerate(first.planes):
            own = [frame.planes[p] for frame in images.frames if isinstance(frame, PlaneSet)]
            across = plane.thickness * plane.normal
            affine = np.column_stack([plane.affine[:, :2], across, plane.origin])
            values = [q.values[:, :, None] for q in own]
            files[f"plane_{p:02d}.nii.gz"] = _nifti(values, affine, images)
    else:
        files["volumes.nii.gz"] = write_nifti(images)
    return stored_zip(files)


def _nifti(frames: list[NDArray[Any]], affine: NDArray[np.float64], images: ImageSequence) -> bytes:
    with needs_extra("images"):
        import nibabel
    full = np.vstack([RAS_TO_LPS @ affine, [0.0, 0.0, 0.0, 1.0]])
    image = nibabel.Nifti1Image(np.stack(frames, axis=-1), full)
    image.set_sform(full, code=1)
    image.set_qform(None, code=0)
    image.header.set_xyzt_units("mm", "sec")
    image.header["pixdim"][4] = 0.0 if images.times is None else np.diff(images.times).mean()
    return gzip.compress(image.to_bytes(), mtime=0)
