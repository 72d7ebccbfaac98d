"""Hand-drawn label maps of ventricles: gaps, crops, missing slices, neighbours unlike."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from seen_surfaces import Truth, in_turn

from modalmotion.images import ImageSequence, Volume
from modalmotion.mesh import face_areas
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion.simulate.surface import random_rotation, rotation_matrix

Floats = NDArray[np.float64]

CAVITY, WALL = 1, 2

# mm: side of a pixel, between slices, beside the ventricle, of the wall at end diastole, and the
# deviation of the reader's line.
_PIXEL, _SLICE, _MARGIN, _THICK, _READER = 1.5, 8.0, 20.0, 9.0, 0.6

# No reader draws a smaller section, mm; of a section so much of the ring must be wall.
_SMALLEST, _RING = 5.0, 0.5

_WAVES = np.arange(1, 5)


@dataclass(frozen=True)
class Drawn:
    """A label map over time, and the surface that was drawn."""

    images: ImageSequence
    truth: Truth


def drawn_maps(seed: int, n: int, n_frames: int = 4) -> Iterator[Drawn]:
    """Draw maps of ventricles: every other is cropped to the heart, every third lacks slices."""
    for k, (parameters, rng) in enumerate(in_turn(seed, 2000, n)):
        recorded = Acquisition(n_frames=n_frames)
        one = simulate_ventricle(parameters, grid=(24, 48), acquisition=recorded, rng=rng)
        # A stack is planned by eye: some degrees off the long axis.
        lean = rotation_matrix(np.array([*rng.normal(0.0, 0.08, 2), 0.0]))
        local = one.vertices.astype(np.float64) @ lean.T
        labels, low = _labels(local, one.faces, rng, lacks_tips=k % 3 == 0)
        if k % 2:
            labels, low = _cropped(labels, low)
        steps = np.array([_PIXEL, _PIXEL, _SLICE])
        place = rotation_matrix(np.array(random_rotation(rng)))
        affine = np.column_stack([place * steps, place @ low])
        frames = tuple(Volume(frame, affine) for frame in labels)
        full = Truth.of(one)
        truth = Truth(local @ place.T, full.faces, full.ends)
        yield Drawn(ImageSequence(frames, one.times, parameters.period), truth)


def torn(case: Drawn, frame: int) -> Drawn:
    """Take the labels of the higher half of the slices out of one frame."""
    frames = list(case.images.frames)
    whole = frames[frame]
    assert isinstance(whole, Volume)
    labels = whole.values.copy()
    drawn = np.flatnonzero((labels == CAVITY).any(axis=(0, 1)))
    labels[:, :, drawn[(len(drawn) + 1) // 2 :]] = 0
    frames[frame] = Volume(labels, whole.affine)
    return Drawn(ImageSequence(tuple(frames), case.images.times, case.images.period), case.truth)


def _labels(
    x: Floats, faces: NDArray[np.int64], rng: np.random.Generator, *, lacks_tips: bool
) -> tuple[NDArray[np.int16], Floats]:
    """Labels (frames, i, j, slices), and the place of the first voxel."""
    low = x.min(axis=(0, 1)) - [_MARGIN, _MARGIN, rng.uniform(1.0, 2.0) * _SLICE]
    high = x.max(axis=(0, 1)) + np.array([_MARGIN, _MARGIN, 2.0 * _SLICE])
    n = np.ceil((high - low) / [_PIXEL, _PIXEL, _SLICE]).astype(int)
    labels = np.zeros((len(x), *n), dtype=np.int16)
    areas = np.array([face_areas(frame, faces).sum() for frame in x])
    rows = x.reshape(len(x), 24, 48, 3)
    for f, frame in enumerate(rows):
        sections = ((k, _section(frame, low[2] + k * _SLICE)) for k in range(n[2]))
        drawn = [(k, *section) for k, section in sections if section is not None]
        if rng.uniform() < 0.25 and len(drawn) > 3:
            # The reader takes the top slice for atrium here, and not in the frame before.
            drawn.pop()
        if lacks_tips and f:
            drawn = drawn[1 + int(rng.uniform() < 0.4) :]
        for k, middle, radii in drawn:
            thick = _THICK * areas[0] / areas[f]
            labels[f, :, :, k] = _slice(labels.shape[1:3], low[:2] - middle, radii, thick, rng)
    return labels, low


def _section(rows: Floats, z: float) -> tuple[Floats, Floats] | None:
    """Middle of a section, and its radii by angle (96,); None where nobody draws one."""
    below = rows[0, :, 2].mean() >= z
    crosses = (rows[0, :, 2] < z) & (rows[-1, :, 2] >= z)
    if below or crosses.mean() < _RING:
        return None
    columns = rows.swapaxes(0, 1)
    points = np.array([[np.interp(z, one[:, 2], one[:, i]) for i in (0, 1)] for one in columns])
    middle = points.mean(axis=0)
    away = points - middle
    radii = np.linalg.norm(away, axis=1)
    if radii.mean() < _SMALLEST:
        return None
    angles = np.arctan2(away[:, 1], away[:, 0])
    order = np.argsort(angles)
    even = np.linspace(-np.pi, np.pi, 96, endpoint=False)
    return middle, np.interp(even, angles[order], radii[order], period=2.0 * np.pi)


def _slice(
    shape: tuple[int, ...], origin: Floats, radii: Floats, thick: float, rng: np.random.Generator
) -> NDArray[np.int16]:
    """Draw one slice: a reader's line, the wall around it, and gaps in the wall."""
    places = _PIXEL * np.moveaxis(np.indices(shape).astype(np.float64), 0, -1) + origin
    angles, r = np.arctan2(places[..., 1], places[..., 0]), np.linalg.norm(places, axis=-1)
    even = np.linspace(-np.pi, np.pi, len(radii), endpoint=False)
    waves = _WAVES[:, None] * even
    shares = rng.normal(0.0, _READER / len(_WAVES) ** 0.5, (2, len(_WAVES)))
    line = radii + shares[0] @ np.cos(waves) + shares[1] @ np.sin(waves)
    edge = np.interp(angles, even, line, period=2.0 * np.pi)
    wall = (r >= edge) & (r < edge + thick)
    for _ in range(rng.poisson(0.7)):
        away = np.abs(np.angle(np.exp(1j * (angles - rng.uniform(-np.pi, np.pi)))))
        wall &= away > rng.uniform(0.1, 0.4)
    return np.where(r < edge, CAVITY, np.where(wall, WALL, 0)).astype(np.int16)


def _cropped(labels: NDArray[np.int16], low: Floats) -> tuple[NDArray[np.int16], Floats]:
    """Cut to the box of the labels of all frames: neither end has a slice beyond it."""
    there = np.argwhere(labels.any(axis=0))
    first, last = there.min(axis=0), there.max(axis=0) + 1
    box = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    return labels[:, *box], low + first * [_PIXEL, _PIXEL, _SLICE]
