"""NIfTI, NRRD, Slicer's .seq.nrrd and MetaImage (.mha): a header, then samples, in one file.

NIfTI is read and written by nibabel: the sform over the qform. The header of NRRD is read by
pynrrd, that of MetaImage from its documentation: raw or zlib. Directions are turned to LPS once.
"""

import gzip
import io
import math
from functools import partial
from typing import Any, Final

import numpy as np

from modalmotion.errors import MalformedFileError, ShapeError, needs_extra
from modalmotion.formats import frame_files, result
from modalmotion.formats.volumes import stack
from modalmotion.images import ImageSequence, PlaneSet, Volume
from modalmotion.limits import ReadLimits
from modalmotion.notes import Note
from modalmotion.numeric.unpacking import Packing, unpacked_head
from modalmotion.representation import Array, Floats

_NIFTI_MM: Final = {"mm": 1.0, "meter": 1e3, "micron": 1e-3, "unknown": 1.0}

# The longer header, of NIfTI-2.
_NIFTI_HEAD: Final = 540

_NIFTI_REMEDY: Final = "Write it again as one .nii or .nii.gz of a volume, or of volumes over time."


@stack.damaged("The NIfTI file is damaged.", _NIFTI_REMEDY, "nibabel", "nibabel.global")
def parse_nifti(data: bytes, limits: ReadLimits) -> result.Parsed:
    """Read a .nii or .nii.gz from bytes.

    Raises
    ------
    MalformedFileError
        If it is no such image.
    """
    with needs_extra("images"):
        import nibabel
    is_packed = data[:2] == b"\x1f\x8b"
    head = unpacked_head(data, "gzip", _NIFTI_HEAD) if is_packed else data[:_NIFTI_HEAD]
    form = nibabel.Nifti2Header if head[4:7] == b"n+2" else nibabel.Nifti1Header
    header: Any = form(head[: form.template_dtype.itemsize])
    kind, shape = header.get_data_dtype(), header.get_data_shape()
    if kind.names or kind.kind not in "iuf":
        raise MalformedFileError("The voxels are colours or complex numbers.", remedy=_NIFTI_REMEDY)
    full = (*shape, 1, 1, 1, 1)[: max(4, len(shape))]
    if any(n != 1 for n in full[4:]):
        raise MalformedFileError(
            f"The NIfTI file has {len(shape)} axes: more than space and time.", remedy=_NIFTI_REMEDY
        )
    limits.require(frames=int(full[3]))
    offset, (slope, intercept) = int(header.get_data_offset()), header.get_slope_inter()
    values = stack.samples(
        *(data, kind, full[:4], limits),
        start=0 if is_packed else offset,
        packing="gzip" if is_packed else None,
        head=offset,
        scale=(1.0, 0.0) if slope is None else (float(slope), float(intercept)),
    )
    length, unit = header.get_xyzt_units()
    to_lps = stack.RAS_TO_LPS * _NIFTI_MM.get(length, 1.0)
    affine = to_lps @ np.asarray(header.get_best_affine(), dtype=np.float64)[:3]
    notes: list[Note] = []
    if not int(header["sform_code"]) and not int(header["qform_code"]):
        notes.append(Note.of("nifti_position_unknown"))
    # Of each axis; an image may have fewer than four.
    interval = float((*header.get_zooms(), 0.0, 0.0, 0.0, 0.0)[3])
    return stack.parsed(
        values, 3, affine, limits, times=interval, unit=unit, form="NIfTI", notes=notes
    )


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
    return frame_files.stored_zip(files)


def _nifti(frames: list[Array], affine: Floats, images: ImageSequence) -> bytes:
    with needs_extra("images"):
        import nibabel
    full = np.vstack([stack.RAS_TO_LPS @ affine, [0.0, 0.0, 0.0, 1.0]])
    image = nibabel.Nifti1Image(np.stack(frames, axis=-1), full)
    image.set_sform(full, code=1)
    image.set_qform(None, code=0)
    image.header.set_xyzt_units("mm", "sec")
    image.header["pixdim"][4] = 0.0 if images.times is None else np.diff(images.times).mean()
    return gzip.compress(image.to_bytes(), mtime=0)


# Directions of the axes: left, posterior and superior count as they are.
_SPACES: Final = ("lps", "ras", "las")
# Kinds of axes that are time, or say nothing of what they are.
_TIMES: Final = ("time", "list")
_PLAIN: Final = ("domain", "space", "none", "???", "scalar", "stub")

_MM: Final = {
    **dict.fromkeys(("", "mm", "millimeter", "millimeters"), 1.0),
    **dict.fromkeys(("m", "meter"), 1e3),
    **dict.fromkeys(("um", "\u00b5m", "micrometer"), 1e-3),
    "cm": 10.0,
    "nm": 1e-6,
}

# Names of the field of samples that are elsewhere.
_DETACHED: Final = ("data file", "datafile")

_GZIP: Final = ("gzip", "gz")

# Lines or bytes to be left out before the samples.
_SKIPS: Final = ("line skip", "lineskip", "byte skip", "byteskip")

# Bytes of a number, by what is left of its type without its sign.
_BYTES: Final = {
    **dict.fromkeys(("char", "int8"), 1),
    **dict.fromkeys(("short", "int16"), 2),
    **dict.fromkeys(("int", "int32"), 4),
    **dict.fromkeys(("longlong", "long long", "int64"), 8),
}
_ORDERS: Final = {"little": "<", "big": ">"}

_NRRD_REMEDY: Final = (
    "Write it as one .nrrd with its data inside, of a volume or a Slicer sequence."
)
_nrrd: Final = partial(MalformedFileError, remedy=_NRRD_REMEDY)


@stack.damaged("The NRRD file is damaged.", _NRRD_REMEDY, "nrrd")
def parse_nrrd(data: bytes, limits: ReadLimits) -> result.Parsed:
    """Read a .nrrd or .seq.nrrd from bytes.

    Raises
    ------
    MalformedFileError
        If it is no such image.
    """
    with needs_extra("images"):
        import nrrd
    stream, lines = io.BytesIO(data), []
    for line in stream:
        if not line.strip():
            break
        # Names of fields are in any case.
        field, colon, value = line.partition(b":")
        is_field = colon and not value.startswith(b"=")
        lines.append(field.lower() + colon + value if is_field else line)
    header = nrrd.read_header(lines)
    return _nrrd_of(header, _nrrd_samples(header, data, stream.tell(), limits), limits)


def _nrrd_samples(header: Any, data: bytes, start: int, limits: ReadLimits) -> Array:
    if any(name in header for name in _DETACHED):
        raise _nrrd("The samples are in another file.")
    encoding = str(header["encoding"]).lower()
    if encoding not in ("raw", *_GZIP) or any(int(header.get(skip, 0)) for skip in _SKIPS):
        raise MalformedFileError(
            "The encoding or the start of the NRRD samples is not supported.",
            remedy="Write it with encoding: raw or gzip, and skip nothing before them.",
        )
    kind = _type(str(header["type"]).lower())
    if kind.itemsize > 1:
        kind = np.dtype(_ORDERS[str(header["endian"]).lower()] + kind.str[1:])
    sizes = [int(n) for n in header["sizes"]]
    if len(sizes) != int(header["dimension"]):
        raise _nrrd("The NRRD file has other 'sizes' than axes.")
    packing: Packing | None = "gzip" if encoding in _GZIP else None
    return stack.samples(data, kind, sizes, limits, start=start, packing=packing)


def _type(name: str) -> np.dtype[Any]:
    if name in ("float", "double"):
        return np.dtype("f4" if name == "float" else "f8")
    plain = name.removesuffix("_t")
    word = plain.removeprefix("unsigned ").removeprefix("signed ").removeprefix("u")
    word = word.removesuffix(" int")
    return np.dtype(f"{'u' if plain.startswith('u') else 'i'}{_BYTES[word]}")


def _nrrd_of(header: Any, values: Array, limits: ReadLimits) -> result.Parsed:
    if values.ndim not in (3, 4):
        raise _nrrd(f"The NRRD file has {values.ndim} axes, not space and time.")
    notes: list[Note] = []
    kinds = [str(kind).lower() for kind in header.get("kinds", ["???"] * values.ndim)]
    directions = header.get("space directions")
    spacings = np.asarray(header.get("spacings", np.full(values.ndim, np.nan)), dtype=np.float64)
    interval = unit = None
    if directions is not None:
        rows = np.array([[math.nan] * 3 if row is None else row for row in directions], float)
        if rows.shape[1] == 4:
            # Time as a fourth direction: an axis along it alone.
            along = np.abs(rows[:, 3]) > 0
            interval = float(rows[along, 3][0]) if along.any() else None
            rows[along] = np.nan
        spatial = [k for k in range(values.ndim) if np.isfinite(rows[k]).all()]
        steps = rows[spatial, :3].T
        units = header.get("space units")
        unit = units[3] if units is not None and len(units) == 4 else None
    else:
        lying = [k for k in range(values.ndim) if kinds[k] not in _TIMES]
        spatial = (lying if len(lying) == 3 else list(range(values.ndim)))[-3:]
        steps = np.diag(np.where(np.isfinite(spacings[spatial]), spacings[spatial], 1.0))
        units = [header["units"][k] for k in spatial] if "units" in header else None
    if len(spatial) != 3:
        raise _nrrd("The NRRD file does not have three axes in space.")
    other = [k for k in range(values.ndim) if k not in spatial]
    for k in other:
        if kinds[k] not in (*_TIMES, *_PLAIN) and values.shape[k] > 1:
            raise MalformedFileError(
                f"Axis {k} of the NRRD file contains the parts of colours or vectors, not time.",
                remedy="Write one number for each voxel, and time as an axis of the kind list.",
            )
    space = str(header.get("space", "")).lower().removesuffix("-time")
    letters = "".join(word[0] for word in space.split("-")) if "-" in space else space
    if letters not in _SPACES:
        notes.append(Note.of("nrrd_space_unknown"))
        letters = "lps"
    signs = np.array([1.0 if letter in "lps" else -1.0 for letter in letters])
    origin = np.asarray(header.get("space origin", np.zeros(3)), dtype=np.float64)[:3]
    scales = signs * _scales(units, notes)
    affine = scales[:, None] * np.column_stack([steps, origin])
    n = values.shape[other[0]] if other else 1
    times: list[float] | float | None = interval
    if times is None:
        times, unit = _times(header, other, spacings, n)
    axis = other[0] if other else None
    return stack.parsed(
        values, axis, affine, limits, times=times, unit=unit, form="NRRD", notes=notes
    )


def _scales(units: Any, notes: list[Note]) -> Floats:
    """Read mm for each unit of the three directions."""
    words = [str(unit).strip().lower() for unit in units][:3] if units is not None else [""] * 3
    if len(words) < 3 or not set(words) <= set(_MM):
        notes.append(Note.of("nrrd_unit_unknown"))
        words = [""] * 3
    return np.array([_MM[word] for word in words])


def _times(
    header: Any, other: list[int], spacings: Floats, n: int
) -> tuple[list[float] | float, str | None]:
    """Read times as Slicer lists them, or the spacing of the axis, and their unit."""
    unit = header.get("axis 0 index unit", header.get("axis 0 unit"))
    listed = str(header.get("axis 0 index values", "")).split()
    if len(listed) == n > 1:
        return [float(word) for word in listed], unit
    if unit is None and other and "units" in header:
        unit = header["units"][other[0]]
    return float(spacings[other[0]]) if other else 0.0, unit


_METAIMAGE_TYPES: Final = {
    f"MET_{'U' * (sign == 'u')}{name}": f"{sign}{n}"
    for name, n in (("CHAR", 1), ("SHORT", 2), ("INT", 4), ("LONG", 4), ("LONG_LONG", 8))
    for sign in "iu"
} | {"MET_FLOAT": "f4", "MET_DOUBLE": "f8"}
_LONGEST_HEADER: Final = 20_000
_METAIMAGE_REMEDY: Final = "Write it as one .mha with its data inside (ElementDataFile = LOCAL)."
_metaimage: Final = partial(MalformedFileError, remedy=_METAIMAGE_REMEDY)


@stack.damaged("The MetaImage file is damaged.", _METAIMAGE_REMEDY)
def parse_metaimage(data: bytes, limits: ReadLimits) -> result.Parsed:
    """Read a .mha of three axes, or four with time the last.

    Raises
    ------
    MalformedFileError
        If it is no such image.
    """
    keys, start = _metaimage_header(data)
    if keys.get("ElementDataFile") != "LOCAL":
        raise _metaimage("The samples are in another file.")
    if not _is_true(keys, "BinaryData", "True"):
        raise MalformedFileError(
            "The samples of the MetaImage file are text.", remedy="Write BinaryData = True."
        )
    if keys["ElementType"] not in _METAIMAGE_TYPES:
        raise MalformedFileError(
            "The samples of the MetaImage file are not single numbers of a known type.",
            remedy=f"Write one of these: {', '.join(_METAIMAGE_TYPES)}.",
        )
    size = [int(word) for word in keys["DimSize"].split()]
    n = len(size)
    if n not in (3, 4) or int(keys.get("ElementNumberOfChannels", "1")) != 1:
        raise _metaimage(f"The image has {n} axes, or several numbers a voxel.")
    is_big = _is_true(keys, "ElementByteOrderMSB") or _is_true(keys, "BinaryDataByteOrderMSB")
    slope, intercept = (
        _numbers(keys, (f"ElementToIntensityFunction{name}",), [otherwise])[0]
        for name, otherwise in (("Slope", 1.0), ("Offset", 0.0))
    )
    values = stack.samples(
        data,
        np.dtype((">" if is_big else "<") + _METAIMAGE_TYPES[keys["ElementType"]]),
        *(size, limits),
        start=start,
        packing="zlib" if _is_true(keys, "CompressedData") else None,
        scale=(slope, intercept),
    )
    spacing = _numbers(keys, ("ElementSpacing", "ElementSize"), [1.0] * n)
    origin = _numbers(keys, ("Offset", "Position", "Origin"), [0.0] * n)
    turn = _numbers(keys, ("TransformMatrix", "Rotation", "Orientation"), list(np.eye(n).ravel()))
    # Row k of the matrix is the direction of axis k.
    axes = np.array(turn).reshape(n, n).T[:3, :3] * np.array(spacing[:3])
    affine = np.column_stack([axes, origin[:3]])
    # The format has no field for a unit of time.
    return stack.parsed(
        *(values, 3 if n == 4 else None, affine, limits),
        times=spacing[3] if n == 4 else 0.0,
        unit=None,
        form="MetaImage",
        notes=[],
    )


def _metaimage_header(data: bytes) -> tuple[dict[str, str], int]:
    keys: dict[str, str] = {}
    start = 0
    while start < _LONGEST_HEADER:
        end = data.index(b"\n", start)
        name, _, value = data[start:end].decode("latin-1").partition("=")
        keys[name.strip()] = value.strip()
        start = end + 1
        if name.strip() == "ElementDataFile":
            return keys, start
    raise _metaimage("The header of the MetaImage file has no end.")


def _is_true(keys: dict[str, str], name: str, otherwise: str = "False") -> bool:
    return keys.get(name, otherwise).lower() in ("true", "1")


def _numbers(keys: dict[str, str], names: tuple[str, ...], otherwise: list[float]) -> list[float]:
    name = next((name for name in names if name in keys), None)
    if name is None:
        return otherwise
    numbers = [float(word) for word in keys[name].split()]
    if len(numbers) != len(otherwise) or not all(map(math.isfinite, numbers)):
        raise _metaimage(f"{name} is not {len(otherwise)} finite numbers.")
    return numbers
