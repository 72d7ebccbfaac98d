"""Images as NIfTI: one file of volumes over time, or a zip with one file for each plane."""

from __future__ import annotations

import gzip
import io
import zipfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ShapeError, needs_extra
from modalmotion.formats.volumes.stack import RAS_TO_LPS
from modalmotion.images import ImageSequence, PlaneSet, Volume

# The earliest date that a zip can state: the same images make the same bytes.
_NO_DATE = (1980, 1, 1, 0, 0, 0)


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
            "The frames are not volumes in one place, which NIfTI holds.",
            remedy="Write planes with write_nifti_zip, and other volumes one by one.",
        )
    values = np.stack([volume.values for volume in volumes], axis=-1)
    return gzip.compress(_nifti(values, volumes[0].affine, images), mtime=0)


def write_nifti_zip(images: ImageSequence) -> bytes:
    """Write images as a zip: one .nii.gz of volumes, or one for each plane of a set."""
    first = next(frame for frame in images.frames if frame is not None)
    files = {}
    if isinstance(first, PlaneSet):
        for p, plane in enumerate(first.planes):
            own = [frame.planes[p] for frame in images.frames if isinstance(frame, PlaneSet)]
            values = np.stack([q.values for q in own], axis=-1)[:, :, None]
            across = plane.thickness * plane.normal
            affine = np.column_stack([plane.affine[:, :2], across, plane.origin])
            files[f"plane_{p:02d}.nii.gz"] = gzip.compress(_nifti(values, affine, images), mtime=0)
    else:
        files["volumes.nii.gz"] = write_nifti(images)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name, _NO_DATE), data)
    return out.getvalue()


def _nifti(values: NDArray[Any], affine: NDArray[np.float64], images: ImageSequence) -> bytes:
    with needs_extra("images"):
        import nibabel
    full = np.vstack([RAS_TO_LPS @ affine, [0.0, 0.0, 0.0, 1.0]])
    image = nibabel.Nifti1Image(values, full)
    image.set_sform(full, code=1)
    image.set_qform(None, code=0)
    step = 0.0 if images.times is None else float(np.diff(images.times).mean())
    image.header.set_xyzt_units("mm", "sec")
    image.header["pixdim"][4] = step
    data: bytes = image.to_bytes()
    return data
