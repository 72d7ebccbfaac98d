"""Images of a simulated ventricle with a known surface."""

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.images import ImageSequence, Plane, PlaneSet, Volume
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import Floats, shown
from modalmotion.simulate import surface, ventricle
from modalmotion.simulate.anatomy import Anatomy, FieldLattice, Tissues
from modalmotion.simulate.parameters import VentricleParameters, between, require_ranges


class ImageKind(StrEnum):
    """How images of a phantom are taken."""

    CT = "ct"
    MRI = "mri"
    ECHO = "echo"
    CINE = "cine"
    LABELS = "labels"


@dataclass(frozen=True)
class _Look:
    """Brightness of blood, wall and chest (least, span, power of the texture), and voxels, mm."""

    blood: float
    wall: float
    chest: tuple[float, float, float]
    spacing: tuple[float, float, float]


_LOOKS: Final = {
    ImageKind.CT: _Look(1.0, 0.45, (-0.3, 0.7, 1.0), (1.0, 1.0, 1.0)),
    ImageKind.MRI: _Look(1.0, 0.3, (0.1, 0.7, 2.0), (1.4, 1.4, 8.0)),
    ImageKind.ECHO: _Look(0.12, 1.0, (0.2, 0.5, 1.0), (1.2, 1.2, 1.2)),
    ImageKind.CINE: _Look(1.0, 0.3, (0.1, 0.7, 2.0), (1.4, 1.4, 8.0)),
    ImageKind.LABELS: _Look(1.0, 0.3, (0.1, 0.7, 2.0), (1.4, 1.4, 8.0)),
}

# Cine: short-axis planes, long-axis planes, and mm of an image's side.
_N_SHORT: Final = 6
_N_LONG: Final = 3
_SIDE: Final = 170.0

# Places through a thick slice, whose mean a pixel is.
_N_THROUGH: Final = 4

# Numbers are stored with the resolution of scanners: brightness 1 is this.
_UNIT: Final = 1000.0

# Width of the transition between tissues, mm.
_EDGE: Final = 1.2


@shown("kind", "images", "truth")
@dataclass(frozen=True, eq=False)
class Phantom:
    """Images and their content.

    Parameters
    ----------
    kind : ImageKind
    images : ImageSequence
    truth : MeshSequence
        The inner surface, papillary muscles within: the convention `pool`.
    landmarks : mapping of "apex" and "base" to (frames, 3) float64, mm
    shifts : (planes, 3) float64, mm
        Shift of the content of each slice; zero if there is none.
    papillary_volume : float, mm^3
        Of the muscles and trabeculae within the surface at end diastole, nearly.
    """

    kind: ImageKind
    images: ImageSequence
    truth: MeshSequence
    landmarks: dict[str, Floats]
    shifts: Floats
    papillary_volume: float


@shown()
@dataclass(frozen=True)
class PhantomSettings:
    """Settings of a phantom's images.

    Parameters
    ----------
    noise : float
        Standard deviation over the brightness of blood; speckle of echo is its own.
    slice_shift : float, mm
        Standard deviation of each slice's place along each of its axes (breath holds).
    papillary : bool
        Whether there are papillary muscles.
    coarseness : float
        Factor on the size of voxels in each direction.
    trabeculae : float, mm
        Depth of a layer of trabeculae at the apex, half muscle at end diastole and nearly all of it
        at end systole; they are within the surface. It ends at four fifths of the height.
    """

    noise: float = between(0.05, 0.0, 10.0)
    slice_shift: float = between(0.0, 0.0, 20.0)
    papillary: bool = True
    coarseness: float = between(1.0, 0.5, 4.0)
    trabeculae: float = between(0.0, 0.0, 10.0)

    def __post_init__(self) -> None:
        require_ranges(self, "phantom")


def simulate_images(
    kind: ImageKind | str,
    parameters: VentricleParameters | None = None,
    *,
    n_frames: int = 25,
    settings: PhantomSettings | None = None,
    rng: "np.random.Generator",
) -> Phantom:
    """Take images of a simulated ventricle.

    Parameters
    ----------
    kind : {"ct", "mri", "echo", "cine", "labels"}
        1 mm in each direction; 1.4 x 1.4 x 8 mm across the long axis; 1.2 mm with speckle, where
        blood is dark; six short-axis and three long-axis planes; or a label map of the slices of
        MRI: 1 the right ventricle, 2 the wall, 3 the cavity.
    parameters : VentricleParameters, optional
        A healthy adult's by default.
    n_frames : int
    settings : PhantomSettings, optional
    rng : numpy.random.Generator

    Returns
    -------
    Phantom
    """
    kind = ImageKind(kind)
    settings = PhantomSettings() if settings is None else settings
    turn, move = rng.normal(0.0, 0.5, 3), rng.normal(0.0, 20.0, 3)
    pose = surface.Pose(rotation=tuple(turn.tolist()), translation=tuple(move.tolist()))
    truth = ventricle.simulate_ventricle(
        parameters, acquisition=ventricle.Acquisition(n_frames=n_frames, pose=pose), rng=rng
    )
    rows = truth.vertices.astype(np.float64).reshape(n_frames, 32, 64, 3)
    anatomy = Anatomy(truth, rng, settings.trabeculae)
    imaging = _Imaging(anatomy.lattice, anatomy.texture, _LOOKS[kind], settings.noise)
    spacing = settings.coarseness * np.array(_LOOKS[kind].spacing)
    if kind is ImageKind.CINE:
        geometry = _cine_planes(rows, spacing)
    elif kind is ImageKind.MRI:
        geometry = [_stack_along(rows, spacing)]
    elif kind is ImageKind.LABELS:
        geometry = [replace(_stack_along(rows, spacing), n_through=1)]
    else:
        turn = scipy.spatial.transform.Rotation.from_rotvec(rng.normal(0.0, 0.4, 3))
        geometry = [_around(rows, turn.as_matrix(), spacing, np.full(3, 20.0))]
    n_slices = sum(g.shape[2] for g in geometry)
    shifts = _shifts(geometry, n_slices, settings.slice_shift, rng)
    frames = []
    for f in range(n_frames):
        moment = anatomy.at(f)
        if not settings.papillary:
            moment = replace(moment, papillary=np.full_like(moment.cavity, 99.0))
        own = [
            _taken(g, kind, moment, imaging, shifts[k : k + g.shape[2]], rng)
            for k, g in enumerate(geometry)
        ]
        frames.append(_image(kind, geometry, own))
    return Phantom(
        kind,
        ImageSequence(
            tuple(frames), None if n_frames < 2 else truth.times, period=truth.facts.period
        ),
        truth,
        {"apex": rows[:, 0].mean(axis=1), "base": rows[:, -1].mean(axis=1)},
        shifts,
        (anatomy.papillary_volume if settings.papillary else 0.0)
        + (anatomy.trabecular_volume if settings.trabeculae > 0 else 0.0),
    )


@dataclass(frozen=True, eq=False)
class _Grid:
    """Regular places of one image: affine (3, 4), mm, its third axis through the slices."""

    affine: Floats
    shape: tuple[int, int, int]
    n_through: int = 1

    def points(self, shifts: Floats) -> Floats:
        """Places (i, j, k through, 3); each slice shows what is `shifts` (slices, 3) back."""
        i, j, k = self.shape
        through = (np.arange(k * self.n_through) + 0.5) / self.n_through - 0.5
        A = self.affine
        x: Floats = (
            A[:, 3]
            + np.arange(i)[:, None, None, None] * A[:, 0]
            + np.arange(j)[:, None, None] * A[:, 1]
            + through[:, None] * A[:, 2]
        )
        return x - np.repeat(np.broadcast_to(shifts, (k, 3)), self.n_through, axis=0)


@dataclass(frozen=True, eq=False)
class _Imaging:
    """Conversion of tissues to brightness."""

    lattice: FieldLattice
    texture: Floats
    look: _Look
    noise: float

    def of(self, moment: Tissues, points: Floats) -> Floats:
        """Brightness at points (..., 3)."""
        look = self.look
        least, span, power = look.chest
        p = points.reshape(-1, 3)
        fields = [moment.cavity, moment.wall, moment.papillary, moment.right, moment.atrium]
        all_at = self.lattice.at(np.stack([*fields, moment.muscle, self.texture], axis=1), p)
        cavity, wall, papillary, right, atrium, muscle, texture = all_at.T
        values = least + span * texture**power
        layers = [
            (right - 3.0, look.wall),
            (right, look.blood),
            (wall, look.wall),
            (atrium, look.blood),
            (cavity, look.blood + muscle * (look.wall - look.blood)),
            # Within the cavity only: in the wall the muscle is wall.
            (np.maximum(papillary, cavity), look.wall),
        ]
        for distance, brightness in layers:
            share = np.clip(0.5 - distance / _EDGE, 0.0, 1.0)
            values += share * (brightness - values)
        seen: Floats = values.reshape(points.shape[:-1])
        return seen

    def labels(self, moment: Tissues, points: Floats) -> NDArray[np.int16]:
        """Labels at points (..., 3): 1 the right ventricle, 2 the wall, 3 the cavity."""
        fields = np.stack([moment.right, moment.wall, moment.cavity], axis=1)
        found = np.zeros(points.shape[:-1], dtype=np.int16)
        for label, distance in enumerate(self.lattice.at(fields, points.reshape(-1, 3)).T, 1):
            found[distance.reshape(found.shape) < 0.0] = label
        return found


def _taken(
    grid: _Grid,
    kind: ImageKind,
    moment: Tissues,
    imaging: _Imaging,
    shifts: Floats,
    rng: "np.random.Generator",
) -> NDArray[np.int16]:
    """Take one image: labels, or brightness, mean through slices, point spread, noise."""
    if kind is ImageKind.LABELS:
        return imaging.labels(moment, grid.points(shifts))
    values = imaging.of(moment, grid.points(shifts))
    i, j, k = grid.shape
    values = values.reshape(i, j, k, grid.n_through).mean(axis=3)
    is_thin = kind in (ImageKind.CT, ImageKind.ECHO)
    values = scipy.ndimage.gaussian_filter(values, [0.5, 0.5, 0.5 if is_thin else 0.0])
    sd = imaging.noise
    if kind is ImageKind.ECHO:
        waves = scipy.ndimage.gaussian_filter(
            rng.normal(size=(2, *values.shape)), (0.0, 0.8, 0.8, 0.8)
        )
        values = np.maximum(values, 0.0) * np.hypot(*waves)
        values = np.log1p(20.0 * values / np.percentile(values, 99))
        values += rng.normal(0.0, 0.1 * sd, values.shape)
    elif kind is ImageKind.CT:
        values += rng.normal(0.0, sd, values.shape)
    else:
        real = values + rng.normal(0.0, sd, values.shape)
        values = np.hypot(real, rng.normal(0.0, sd, values.shape))
    whole: NDArray[np.int16] = np.rint(_UNIT * values).clip(-32768, 32767).astype(np.int16)
    return whole


def _image(
    kind: ImageKind, geometry: list[_Grid], values: list[NDArray[np.int16]]
) -> Volume | PlaneSet:
    if kind is not ImageKind.CINE:
        return Volume(values[0], geometry[0].affine)
    return PlaneSet(
        tuple(
            Plane(v[:, :, 0], g.affine[:, [0, 1, 3]], float(np.linalg.norm(g.affine[:, 2])))
            for g, v in zip(geometry, values, strict=True)
        )
    )


def _frame_of(rows: Floats) -> tuple[Floats, Floats, float]:
    """Apex, unit vectors as columns (two across, the long axis last) and length, frame 0."""
    apex, base = rows[0, 0].mean(axis=0), rows[0, -1].mean(axis=0)
    length = float(np.linalg.norm(base - apex))
    axis = (base - apex) / length
    first = rows[0, rows.shape[1] // 2, 0] - apex
    first -= (first @ axis) * axis
    first /= np.linalg.norm(first)
    return apex, np.stack([first, np.cross(axis, first), axis], axis=1), length


def _around(rows: Floats, axes: Floats, spacing: Floats, margin: Floats) -> _Grid:
    local = rows.reshape(-1, 3) @ axes
    low, high = local.min(axis=0) - margin, local.max(axis=0) + margin
    i, j, k = (int(np.ceil(n)) + 1 for n in (high - low) / spacing)
    affine = np.column_stack([axes * spacing, axes @ low])
    return _Grid(affine, (i, j, k))


def _stack_along(rows: Floats, spacing: Floats) -> _Grid:
    _, axes, _ = _frame_of(rows)
    grid = _around(rows, axes, spacing, np.array([22.0, 22.0, 10.0]))
    return replace(grid, n_through=_N_THROUGH)


def _cine_planes(rows: Floats, spacing: Floats) -> list[_Grid]:
    """Short-axis planes from apex to base, then long-axis planes turned about the axis."""
    apex, axes, length = _frame_of(rows)
    first, second, axis = axes.T
    width, _, thickness = spacing.tolist()
    n = int(_SIDE / width)
    heights = np.linspace(0.1, 0.95, _N_SHORT) * length
    planes = [(first, second, axis, apex + height * axis) for height in heights]
    for k in range(_N_LONG):
        angle = np.pi * k / _N_LONG
        u = np.cos(angle) * first + np.sin(angle) * second
        planes.append((u, axis, np.cross(u, axis), apex + length / 2 * axis))
    grids = []
    for u, v, w, middle in planes:
        origin = middle - (n - 1) / 2 * width * (u + v)
        affine = np.column_stack([width * u, width * v, thickness * w, origin])
        grids.append(_Grid(affine, (n, n, 1), _N_THROUGH))
    return grids


def _shifts(geometry: list[_Grid], n_slices: int, sd: float, rng: "np.random.Generator") -> Floats:
    """Draw a shift of each slice in its plane, (slices, 3), mm."""
    shifts = np.zeros((n_slices, 3))
    if sd == 0:
        return shifts
    for k in range(n_slices):
        axes = geometry[min(k, len(geometry) - 1)].affine[:, :2]
        shifts[k] = (axes / np.linalg.norm(axes, axis=0)) @ rng.normal(0.0, sd, 2)
    return shifts
