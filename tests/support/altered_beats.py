"""A ventricle's beat as it might be recorded, sent or scaled wrongly, of many kinds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from modalmotion.mesh.sequence import MeshSequence

Alter = Callable[[MeshSequence, np.random.Generator], MeshSequence]


def mirror_image(beat: MeshSequence, rng: np.random.Generator) -> MeshSequence:
    """One axis of the coordinates negated."""
    return replace(beat, vertices=beat.vertices * np.where(np.arange(3) == rng.integers(3), -1, 1))


def backwards(beat: MeshSequence, rng: np.random.Generator) -> MeshSequence:
    """Frames in the opposite order."""
    del rng
    return replace(beat, vertices=beat.vertices[::-1].copy())


def half_beat(beat: MeshSequence, rng: np.random.Generator) -> MeshSequence:
    """Half of the frames, from anywhere on."""
    n = beat.n_frames // 2
    return _part(beat, int(rng.integers(beat.n_frames - n + 1)) + np.arange(n))


def two_beats(beat: MeshSequence, rng: np.random.Generator) -> MeshSequence:
    """The beat and the same again."""
    del rng
    return replace(beat, vertices=np.concatenate([beat.vertices] * 2), times=None)


def without_systole(beat: MeshSequence, rng: np.random.Generator) -> MeshSequence:
    """The frames of a third of a beat that begins at end diastole left out, from about there."""
    phase = np.arange(beat.n_frames) / beat.n_frames
    first = rng.uniform(0.0, 0.1)
    kept = _part(beat, np.flatnonzero((phase < first) | (phase > first + 0.33)))
    return kept if rng.uniform() < 0.5 else replace(kept, times=None)


def scaled_motion(factor: float) -> Alter:
    """Motion about its mean over time times a factor."""

    def scaled(beat: MeshSequence, rng: np.random.Generator) -> MeshSequence:
        del rng
        mean = beat.vertices.mean(axis=0, dtype=np.float64)
        return replace(beat, vertices=mean + factor * (beat.vertices - mean))

    return scaled


def scaled(factor: float) -> Alter:
    """Another size."""

    def larger(beat: MeshSequence, rng: np.random.Generator) -> MeshSequence:
        del rng
        return replace(beat, vertices=factor * beat.vertices)

    return larger


def stretched(beat: MeshSequence, rng: np.random.Generator) -> MeshSequence:
    """Twice as long for its width: another surface of the same topology."""
    del rng
    middle = beat.vertices.mean(axis=(0, 1))
    x = beat.vertices - middle
    along = np.linalg.svd(x.mean(axis=0), full_matrices=False)[2][0]
    return replace(beat, vertices=middle + x + (x @ along)[..., None] * along)


def _part(beat: MeshSequence, frames: np.ndarray) -> MeshSequence:
    times = None if beat.times is None else beat.times[frames]
    return replace(beat, vertices=beat.vertices[frames], times=times)


ALTERED: Final[dict[str, tuple[Alter, tuple[str, ...]]]] = {
    "mirrored": (mirror_image, ("mirrored",)),
    "time reversed": (backwards, ("reversed time",)),
    "half a beat": (half_beat, ("incomplete cycle", "reversed time", "out of domain")),
    "two beats": (two_beats, ("out of domain",)),
    "frames missing in systole": (without_systole, ("incomplete cycle",)),
    "motion negated": (scaled_motion(-1.0), ("reversed time", "out of domain")),
    "motion x0.2": (scaled_motion(0.2), ("other amount of motion", "no motion")),
    "motion x3": (scaled_motion(3.0), ("other amount of motion",)),
    "size x0.5": (scaled(0.5), ("other size",)),
    "size x2": (scaled(2.0), ("other size",)),
    "size x1000": (scaled(1000.0), ("other size",)),
    "twice as long": (stretched, ("other size", "out of domain")),
}
"""How each kind is made, and the flags that name what is wrong with it."""
