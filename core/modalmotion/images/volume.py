"""Images in space: volumes and planes, values between samples, and sequences over time."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, ClassVar, Final, TypeAlias

import numpy as np
import scipy

from modalmotion.arguments.checking import FrozenArrays
from modalmotion.errors import ParameterError, ShapeError
from modalmotion.mesh.checks import require_times
from modalmotion.notes import Note
from modalmotion.representation import Array, Floats, shown

# mm: finer and coarser samples are those of a microscope or of a wrong unit.
_FINEST: Final = 1e-3
_COARSEST: Final = 1e3

# Volume of a cell over that of the box with the same edges: less is a plane.
_FLATTEST: Final = 1e-3


def require_samples(values: Any, n_axes: int) -> Array:
    """Check that samples are real numbers along so many axes; return them, read-only.

    Raises
    ------
    ShapeError
    """
    samples = np.asarray(values)
    if samples.ndim != n_axes or 0 in samples.shape:
        raise ShapeError(
            f"The samples have the shape {samples.shape}, not {n_axes} axes of one sample or more.",
            remedy="Give one number for each voxel or pixel; colours must be one grey value.",
        )
    if samples.dtype.kind not in "iufb":
        raise ShapeError(
            f"The samples are of the type {samples.dtype}, and no real numbers.",
            remedy="Give integers or floating-point numbers.",
        )
    samples = samples.astype(np.uint8) if samples.dtype.kind == "b" else samples.view()
    samples.setflags(write=False)
    return samples


def require_affine(affine: Any, n_axes: int) -> Floats:
    """Check the map from indices to LPS mm, (4, n_axes + 1) or (3, n_axes + 1).

    Returns
    -------
    (3, n_axes + 1) float64
        A column for the step along each axis, and the place of the first sample.

    Raises
    ------
    ParameterError
        Where it is not finite, or its axes do not span as many directions.
    """
    A = np.array(affine, dtype=np.float64)
    if A.shape not in ((3, n_axes + 1), (4, n_axes + 1)):
        raise ShapeError(
            f"The affine has the shape {A.shape}, not (4, {n_axes + 1}).",
            remedy="Give columns with the step along each axis and the first sample's place, mm.",
        )
    A = A[:3]
    steps = np.linalg.norm(A[:, :-1], axis=0)
    if not np.isfinite(A).all() or not ((steps >= _FINEST) & (steps <= _COARSEST)).all():
        raise ParameterError(
            f"The samples are {', '.join(f'{s:.3g}' for s in steps)} mm apart.",
            remedy=f"Give finite spacings between {_FINEST:g} and {_COARSEST:g} mm.",
        )
    spanned = float(np.sqrt(np.linalg.det((A[:, :-1] / steps).T @ (A[:, :-1] / steps)).clip(0.0)))
    if spanned < _FLATTEST:
        raise ParameterError(
            "Two axes of the image run along one another, so that its voxels have no volume.",
            remedy="Give axes in different directions.",
        )
    A.setflags(write=False)
    return A


# Of the eight or four samples around a place, by weight: fewer that are there say too little.
_LEAST_SHARE = 0.5


def among_missing(values: Array, indices: Floats) -> Floats:
    """Weigh the samples around indices (n, axes) that are there; no array as large as the image."""
    last = np.array(values.shape) - 1
    with np.errstate(invalid="ignore"):
        inside = ((indices >= 0) & (indices <= last)).all(axis=1)
    places = indices[inside]
    low = np.minimum(places.astype(np.int64), np.maximum(last - 1, 0))
    share = places - low
    total, weight = np.zeros(len(places)), np.zeros(len(places))
    for corner in product((0, 1), repeat=len(last)):
        step = np.array(corner)
        own = np.where(step, share, 1.0 - share).prod(axis=1)
        samples = values[tuple(np.minimum(low + step, last).T)].astype(np.float64)
        is_there = np.isfinite(samples)
        total += np.where(is_there, own * np.where(is_there, samples, 0.0), 0.0)
        weight += np.where(is_there, own, 0.0)
    found = np.full(len(indices), np.nan)
    enough = weight >= _LEAST_SHARE
    found[inside] = np.where(enough, total / np.maximum(weight, _LEAST_SHARE), np.nan)
    return found


@dataclass(frozen=True, eq=False)
class _Samples(FrozenArrays):
    """Samples in space, along as many axes as a subclass has."""

    values: Array
    affine: Floats

    _n_axes: ClassVar[int]

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", require_samples(self.values, self._n_axes))
        object.__setattr__(self, "affine", require_affine(self.affine, self._n_axes))

    @property
    def spacing(self) -> tuple[float, ...]:
        """Distance from sample to sample along each axis, mm."""
        return tuple(np.linalg.norm(self.affine[:, :-1], axis=0).tolist())

    @property
    def origin(self) -> Floats:
        """Middle of the first sample, (3,) float64, mm."""
        return self.affine[:, -1]

    @cached_property
    def _are_missing(self) -> bool:
        # A slab at a time.
        slabs = self.values if self.values.dtype.kind == "f" else ()
        return not all(np.isfinite(slab).all() for slab in slabs)

    @cached_property
    def _inverse(self) -> Floats:
        return np.asarray(np.linalg.pinv(self.affine[:, :-1]), dtype=np.float64)

    def indices(self, points: Floats) -> Floats:
        """Turn points (n, 3), mm, or their feet on a plane, to indices (n, axes)."""
        found: Floats = (points - self.origin) @ self._inverse.T
        return found

    def sample(self, points: Floats) -> Floats:
        """Interpolate at points (n, 3), mm, or at their feet on a plane, linearly: (n,) float64.

        NaN outside the image, and where most samples around are missing.
        """
        places = self.indices(points)
        if self._are_missing:
            return among_missing(self.values, places)
        found: Floats = scipy.ndimage.map_coordinates(
            self.values, np.ascontiguousarray(places.T), output=np.float64, order=1, cval=np.nan
        )
        return found


@shown("values", "spacing")
@dataclass(frozen=True, eq=False)
class Volume(_Samples):
    """An image I[i, j, k] in space.

    Parameters
    ----------
    values : (i, j, k) array of real numbers
        As they are stored: not copied. NaN if nothing is known.
    affine : (4, 4) or (3, 4) float64, mm
        From indices to LPS coordinates of the voxels' middles. Sheared and left-handed ones are
        as good as others.

    Raises
    ------
    ShapeError
        If the samples are no real numbers along three axes.
    ParameterError
        If the affine is not finite or flat.
    """

    _n_axes = 3

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of voxels along each axis."""
        i, j, k = self.values.shape
        return i, j, k

    def extents(self, directions: Floats) -> Floats:
        """How far a voxel reaches along unit vectors (n, 3): (n,) float64, mm."""
        steps = np.linalg.norm(self.affine[:, :3], axis=0)
        along = directions @ (self.affine[:, :3] / steps)
        extents: Floats = np.linalg.norm(along * steps, axis=1)
        return extents


@shown("values", "spacing", "thickness")
@dataclass(frozen=True, eq=False)
class Plane(_Samples):
    """An image I[i, j] on a plane in space.

    Parameters
    ----------
    values : (i, j) array of real numbers
        As they are stored: not copied. NaN if nothing is known.
    affine : (4, 3) or (3, 3) float64, mm
        From indices to LPS coordinates of the pixels' middles.
    thickness : float, mm
        Of the slice, which a pixel is the mean over.
    """

    thickness: float = 1.0

    _n_axes = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (np.isfinite(self.thickness) and self.thickness > 0):
            raise ParameterError(
                f"A slice is {self.thickness} mm thick.", remedy="Give a thickness above zero."
            )

    @cached_property
    def normal(self) -> Floats:
        """Unit vector across the plane, (3,) float64."""
        across = np.cross(self.affine[:, 0], self.affine[:, 1])
        unit: Floats = across / np.linalg.norm(across)
        return unit

    def heights(self, points: Floats) -> Floats:
        """Distance of points (n, 3) above the plane, (n,) float64, mm."""
        heights: Floats = (points - self.origin) @ self.normal
        return heights


@shown("planes")
@dataclass(frozen=True, eq=False)
class PlaneSet:
    """Planes that show one moment: short and long axis together.

    Parameters
    ----------
    planes : tuple of Plane
    """

    planes: tuple[Plane, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "planes", tuple(self.planes))
        if not self.planes or not all(isinstance(plane, Plane) for plane in self.planes):
            raise ShapeError("A set of planes needs one plane or more.", remedy="Give planes.")

    def __len__(self) -> int:
        return len(self.planes)


def slices_of(volume: Volume) -> PlaneSet:
    """Take a volume of thick slices apart into planes, across its coarsest axis."""
    axis = int(np.argmax(volume.spacing))
    others = [i for i in range(3) if i != axis]
    step, columns = volume.affine[:, axis], volume.affine[:, others]
    normal = np.cross(columns[:, 0], columns[:, 1])
    thickness = abs(float(step @ normal) / float(np.linalg.norm(normal)))
    planes = []
    # Views: nothing of the volume is copied.
    for k, values in enumerate(np.moveaxis(volume.values, axis, 0)):
        origin = volume.affine[:, 3] + k * step
        affine = np.column_stack([columns, origin])
        planes.append(Plane(values, affine, thickness))
    return PlaneSet(tuple(planes))


Image: TypeAlias = Volume | PlaneSet

# Voxels longer than this times their width are slices: what is between two of them is not seen.
_SLICED: Final = 2.5

# Slices with fewer voxels through a volume are a few slices, not a volume.
_FEWEST: Final = 4


@shown("n_frames", "frames", "times")
@dataclass(frozen=True, eq=False)
class ImageSequence(FrozenArrays):
    """Images of one object over time, in LPS mm.

    Parameters
    ----------
    frames : tuple of Volume, PlaneSet or None
        None if a frame is missing. Sets of planes have as many planes in each frame, in the
        same order.
    times : (frames,) float64, s, or None
    period : float or None, s
        Of the cycle, where the file states it.
    notes : tuple of Note
        Of the file, for the user.
    """

    frames: tuple[Image | None, ...]
    times: Floats | None = None
    period: float | None = None
    notes: tuple[Note, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "frames", tuple(self.frames))
        if not any(frame is not None for frame in self.frames):
            raise ShapeError(
                "The images have no frame.", remedy="Give a volume or planes for one frame or more."
            )
        if self.times is not None:
            object.__setattr__(self, "times", require_times(self.times, len(self.frames)))
        sizes = {len(frame) for frame in self.frames if isinstance(frame, PlaneSet)}
        if len(sizes) > 1:
            raise ShapeError(
                f"Frames have {min(sizes)} planes, others {max(sizes)}.",
                remedy="Give each frame the same planes; one that is missing may be all NaN.",
            )

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.frames)

    @property
    def finest(self) -> float:
        """Least distance between neighbouring samples, mm."""
        parts = (part for frame in self.frames if frame is not None for part in parts_of(frame))
        return min(min(part.spacing) for part in parts)

    @cached_property
    def id(self) -> str:
        """Digest (sha256, hex) of samples, places and times: the same for the same content."""
        digest = hashlib.sha256(b"modalmotion.images 1\0")
        for array in (self.times, None if self.period is None else np.array([self.period])):
            _add(digest, array)
        for frame in self.frames:
            parts: Sequence[Volume | Plane] = () if frame is None else parts_of(frame)
            _add(digest, np.array([len(parts), isinstance(frame, PlaneSet)]))
            for part in parts:
                _add(digest, part.affine)
                _add(digest, part.values)
                if isinstance(part, Plane):
                    _add(digest, np.array([part.thickness]))
        return digest.hexdigest()

    def sliced(self) -> "ImageSequence":
        """Take volumes of thick slices apart into planes."""
        frames = tuple(
            slices_of(frame) if isinstance(frame, Volume) and is_sliced(frame) else frame
            for frame in self.frames
        )
        return ImageSequence(frames, self.times, self.period, self.notes)


def parts_of(frame: Image) -> tuple[Volume | Plane, ...]:
    """Volume, or planes, that a frame consists of."""
    return frame.planes if isinstance(frame, PlaneSet) else (frame,)


def _add(digest: "hashlib._Hash", array: Array | None) -> None:
    """Add an array's type and shape and its elements, in one order of bytes."""
    if array is None:
        digest.update(b"none\0")
        return
    kind = array.dtype.newbyteorder("<")
    digest.update(f"{kind.str} {array.shape}\0".encode())
    digest.update(np.ascontiguousarray(array, dtype=kind).data)


def is_sliced(volume: Volume) -> bool:
    """Whether a volume is a stack of thick slices."""
    return max(volume.spacing) > _SLICED * min(volume.spacing) or min(volume.shape) < _FEWEST


Images: TypeAlias = ImageSequence | Volume | PlaneSet
"""One image, or a sequence of them."""


def images_in(observed: Any) -> ImageSequence | None:
    """Read images, or a list with an image among its frames, as a sequence; None of other things.

    Raises
    ------
    ShapeError
        If other things are among the images.
    """
    if isinstance(observed, ImageSequence):
        return observed
    if isinstance(observed, (Volume, PlaneSet)):
        return ImageSequence((observed,))
    if not isinstance(observed, Sequence):
        return None
    kinds = [isinstance(item, (Volume, PlaneSet)) for item in observed]
    if not any(kinds):
        return None
    for k, (item, is_image) in enumerate(zip(observed, kinds, strict=True)):
        if item is not None and not is_image:
            raise ShapeError(
                f"Frame {k} is a {type(item).__name__}, others are images.",
                remedy="Give images in all frames, and None if one is missing.",
                frame=k,
            )
    return ImageSequence(tuple(observed))
