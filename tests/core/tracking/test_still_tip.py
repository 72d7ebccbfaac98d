"""Blood that leaves the tip does not take the surface with it; other motion is as it was."""

from __future__ import annotations

import numpy as np
import pytest
from ellipsoid_images import (
    AXES,
    BASE,
    LANDMARKS,
    LENGTH,
    MIDDLE,
    RADIUS,
    Floats,
    off_surface,
    volume,
)

from modalmotion.images import ImageSequence, Volume
from modalmotion.mesh.standard_surfaces import standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topology import CYLINDER
from modalmotion.template import make_template
from modalmotion.tracking import Observation, image_frames, track
from modalmotion.tracking.image_frames import held

SHAPE = (27, 27, 35)
AFFINE = np.column_stack([3.0 * np.eye(3), MIDDLE - 1.5 * (np.array(SHAPE) - 1)])
FULL = volume(affine=AFFINE, shape=SHAPE)
HEIGHTS = (7.0, 14.0)
MARKS = {"apex": LANDMARKS["apex"], "base": np.tile(BASE, (1 + len(HEIGHTS), 1))}


def without_blood(height: float) -> Volume:
    """The wall as it was, and no blood in the lowest so many mm."""
    index = np.stack(np.meshgrid(*map(np.arange, SHAPE), indexing="ij"), axis=-1)
    local = (index @ AFFINE[:, :3].T + AFFINE[:, 3] - MIDDLE) @ AXES
    inside = np.linalg.norm(local / [RADIUS + 1.0, RADIUS + 1.0, LENGTH + 1.0], axis=-1) < 1.0
    gone = inside & (local[..., 2] < height - LENGTH)
    return Volume(np.where(gone, 40.0, FULL.values), AFFINE)


def rise_of(images: ImageSequence, **landmarks: Floats) -> float:
    """How far the tip rises along the axis at most, mm."""
    result = track(images, landmarks=MARKS | landmarks, modes=18, time="open")
    x = result.sequence.vertices[:, :64].mean(axis=1)
    return float(((x - x[0]) @ AXES[:, 2]).max())


@pytest.mark.thorough
def test_the_tip_stays_where_blood_leaves_it(monkeypatch: pytest.MonkeyPatch) -> None:
    images = ImageSequence((FULL, *map(without_blood, HEIGHTS)))
    assert rise_of(images) < 8.0
    stated = LANDMARKS["apex"] + np.outer([0.0, 7.0, 14.0], AXES[:, 2])
    assert rise_of(images, apex=stated) > 11.0
    monkeypatch.setattr(image_frames, "held", lambda marks, *_: tuple(marks))
    assert rise_of(images) > 11.0


def test_only_the_tip_of_a_cup_is_held_and_only_where_no_apex_is_stated() -> None:
    result = track(ImageSequence((FULL, FULL, FULL)), landmarks=LANDMARKS, modes=7)
    template = result.template
    assert off_surface(template.vertices) < 1.0
    stated = (Observation(LANDMARKS["apex"][None], places=("apex",)),)
    marks = held(((), stated, ()), template, 0)
    assert [len(frame) for frame in marks] == [0, 1, 1]
    assert marks[1] == stated
    assert marks[2][0].places == ("apex",)
    tube = standard_surface(Lattice(CYLINDER, (4, 8)))
    sheet = make_template(tube)
    assert held(((), ()), sheet, 0) == ((), ())
