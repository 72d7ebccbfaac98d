"""Extreme images: the same surface, or an error or a note that says what is wrong with them."""

from __future__ import annotations

import numpy as np
import pytest
from ellipsoid_images import (
    AXES,
    BASE,
    LANDMARKS,
    MIDDLE,
    RADIUS,
    Floats,
    enclosed,
    off_surface,
    volume,
)

from modalmotion.errors import InputError
from modalmotion.images import ImageSequence, Volume
from modalmotion.tracking import Track, track

SHAPE = (27, 27, 35)
AFFINE = np.column_stack([3.0 * np.eye(3), MIDDLE - 1.5 * (np.array(SHAPE) - 1)])


def coarse(radius: float = RADIUS, seed: int = 0, affine: Floats = AFFINE) -> Volume:
    return volume(radius, affine=affine, shape=SHAPE, seed=seed)


USUAL = coarse()
VALUES = USUAL.values


def tracked(image: Volume | ImageSequence, **options: object) -> Track:
    return track(image, **({"landmarks": LANDMARKS, "modes": 7} | options))  # type: ignore[arg-type]


def off(result: Track) -> float:
    """Mean distance from the truth below the rim, which only landmarks place, mm."""
    x = result.sequence.vertices[0].astype(np.float64)
    return off_surface(x[(x - MIDDLE) @ AXES[:, 2] < 26.0])


def doubts(result: Track) -> str:
    """What is noted besides what all tracks say."""
    usual = ("undetermined", "along the surface it comes from the prior", "so round about the axis")
    return " ".join(str(n) for n in result.notes if not any(part in n for part in usual))


def padded(value: float) -> Volume:
    affine = AFFINE.copy()
    affine[:, 3] -= 6.0 * AFFINE[:, :3].sum(axis=1)
    return Volume(np.pad(VALUES, 6, constant_values=value), affine)


def sheared() -> Volume:
    affine = AFFINE.copy()
    affine[:, 2] += 0.6 * affine[:, 0]
    affine[:, 3] -= 0.3 * (SHAPE[2] - 1) * AFFINE[:, 0]
    return coarse(affine=affine)


def thick() -> Volume:
    steps = np.array([2.0, 2.0, 12.0])
    affine = np.column_stack([np.diag(steps), MIDDLE - steps * (np.array([40, 40, 9]) - 1) / 2])
    return volume(affine=affine, shape=(40, 40, 9))


@pytest.mark.every(2)
@pytest.mark.parametrize(
    "image",
    [
        padded(-2000.0),
        padded(np.nan),
        Volume(np.clip(VALUES, 45.0, 80.0), AFFINE),
        Volume((1000.0 - 3.0 * VALUES).astype(np.int16), AFFINE),
        sheared(),
        Volume(
            VALUES[:, ::-1], AFFINE @ np.array([*np.eye(4)[:1], [0, -1, 0, 26], *np.eye(4)[2:]])
        ),
        thick(),
    ],
    ids=["padded", "padded with nan", "clipped", "rescaled", "sheared", "negative", "1 to 6"],
)
def test_the_same_surface_is_found_and_nothing_doubted(image: Volume) -> None:
    result = tracked(image)
    assert off(result) < 0.4
    assert result.volumes == pytest.approx([enclosed()], rel=0.06)
    assert doubts(result) == ""


def test_of_two_objects_the_one_with_the_landmarks_is_followed() -> None:
    index = np.stack(np.meshgrid(*map(np.arange, SHAPE), indexing="ij"), axis=-1)
    local = (index @ AFFINE[:, :3].T + AFFINE[:, 3] - MIDDLE) @ AXES
    beside = np.linalg.norm((local - [RADIUS + 20.0, 0, 0]) / [14.0, 22, 34], axis=-1) < 1.0
    result = tracked(Volume(np.where(beside, 100.0, VALUES), AFFINE))
    assert off(result) < 0.4


def test_an_object_that_is_cut_off_says_so_and_how_unsure_its_fraction_is() -> None:
    full = ImageSequence((USUAL, coarse(18.0, 1)))
    cut = ImageSequence(tuple(Volume(f.values[:15], f.affine) for f in full.frames if f))  # type: ignore[union-attr]
    whole, part = tracked(full), tracked(cut)
    assert part.coverage.max() < 0.8
    assert "points are at less than 80% of the surface" in doubts(part)
    assert whole.ejection_fraction_bound is not None
    assert part.ejection_fraction_bound is not None
    true = 100.0 * (1.0 - enclosed(18.0) / enclosed())
    assert part.ejection_fraction == pytest.approx(true, abs=part.ejection_fraction_bound)
    assert part.ejection_fraction_bound > whole.ejection_fraction_bound


@pytest.mark.every(2)
@pytest.mark.parametrize(
    ("landmarks", "told"),
    [
        ({name: place + 20.0 * AXES[:, 0] for name, place in LANDMARKS.items()}, "check both"),
        ({"apex": LANDMARKS["base"], "base": LANDMARKS["apex"]}, "are the two swapped"),
    ],
    ids=["aside", "swapped"],
)
def test_wrong_landmarks_are_doubted(landmarks: dict[str, Floats], told: str) -> None:
    assert told in doubts(tracked(USUAL, landmarks=landmarks))


def scaled(size: float) -> tuple[Volume, dict[str, Floats]]:
    return Volume(VALUES, AFFINE * size), {name: x * size for name, x in LANDMARKS.items()}


@pytest.mark.parametrize(
    ("image", "landmarks", "told"),
    [
        (*scaled(0.1), "are 6.8 mm apart"),
        (*scaled(5.0), "No object is seen"),
        (USUAL, {"apex": BASE, "base": BASE}, "are 0 mm apart"),
        (Volume(VALUES[:13], AFFINE), LANDMARKS, "No object is seen"),
        (Volume(VALUES[:, :, 17:18], AFFINE), LANDMARKS, "outside the images"),
    ],
    ids=["tiny", "huge", "one place", "half", "one slice"],
)
def test_no_shape_comes_out_where_none_can_be_told(
    image: Volume, landmarks: dict[str, Floats], told: str
) -> None:
    with pytest.raises(InputError, match=told) as error:
        tracked(image, landmarks=landmarks)
    assert error.value.remedy


@pytest.mark.thorough
def test_frames_that_are_repeated_or_come_at_other_times_are_what_they_are() -> None:
    still = tracked(ImageSequence((USUAL, USUAL, USUAL)))
    assert still.ejection_fraction == pytest.approx(0.0, abs=0.2)
    frames = (USUAL, coarse(20.0, 1), coarse(17.0, 2))
    uneven = tracked(ImageSequence(frames, np.array([0.0, 0.1, 0.5])))
    part = tracked(ImageSequence(frames, np.array([0.0, 0.1, 0.2])), time="open")
    true = 100.0 * (1.0 - enclosed(17.0) / enclosed())
    for result in (uneven, part):
        # Where nobody states the base it is assumed to descend; that of these stands still.
        bound = result.ejection_fraction_bound
        assert bound is not None
        assert result.ejection_fraction == pytest.approx(true, abs=bound)
        assert bound < 8.0
