"""Ends that few frames state: the tip stays, the base follows the valve, beyond it are no edges."""

from __future__ import annotations

import numpy as np
import pytest
from ellipsoid_images import (
    AXES,
    BASE,
    CUT,
    LANDMARKS,
    LENGTH,
    MIDDLE,
    RADIUS,
    enclosed,
    spheroid,
    volume,
)

from modalmotion.images import ImageSequence, Volume
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion.tracking import Observation, track
from modalmotion.tracking.image_frames import below_base, with_end
from modalmotion.tracking.image_view import Imaging, Levels
from modalmotion.tracking.moving_base import base_by_volume

TEMPLATE = spheroid()
HEIGHT = CUT + LENGTH


def landmark(height: float, sd: float | None = None) -> Observation:
    place = MIDDLE + height * AXES[:, 2]
    return Observation(place[None], sd=sd, places=("base",))


def height_of(frame: tuple[Observation, ...]) -> float:
    (own,) = (part for part in frame if part.places == ("base",))
    return float((own.points[0] - MIDDLE) @ AXES[:, 2])


def test_what_is_stated_stays_and_the_rest_is_where_valves_go_by_the_volume_ejected() -> None:
    stated = ((landmark(CUT),), (landmark(CUT - 9.0),), (), ())
    rough = with_end(stated, 0, "base", MIDDLE, 1.0)
    assert rough[:2] == stated[:2]
    assert len(with_end(stated, 0, "apex", MIDDLE, 1.0)[1]) == 2
    assert height_of(rough[2]) == pytest.approx(0.0)
    x = TEMPLATE.vertices
    small = MIDDLE + ((x - MIDDLE) @ AXES * [0.8, 0.8, 1.0]) @ AXES.T
    places, covariance = base_by_volume(
        ((landmark(CUT),), (), ()), TEMPLATE, 0, np.stack([x, x, small])
    )
    # Of 36 %, before the base moves, it is 0.185 mm per percent down in 90, and of none none.
    height = (places - MIDDLE) @ AXES[:, 2]
    assert height[1] == pytest.approx(CUT, abs=1.0)
    down = CUT - height[2]
    assert 36.0 < down * 90.0 / HEIGHT / 0.185 < 55.0
    sd = np.sqrt(np.diag(covariance))
    assert sd[0] == 0.0
    assert 1.5 * HEIGHT / 90.0 <= sd[1] < sd[2] < 0.5 * down
    # A frame that states it tells how far it goes in others.
    twice = base_by_volume(
        ((landmark(CUT),), (landmark(CUT - 3.0),), ()), TEMPLATE, 0, np.stack([x, small, small])
    )
    assert CUT - (twice[0][2] - MIDDLE) @ AXES[:, 2] < down - 1.0
    assert np.diag(twice[1])[:2].tolist() == [0.0, 0.0]
    assert twice[1][2, 2] < covariance[2, 2]


def test_edges_beyond_the_base_do_not_count() -> None:
    imaging = Imaging(Levels(100.0, 0.0, 1.0), np.zeros(3), MIDDLE, np.zeros((1, 3)))
    assert below_base(imaging, (), TEMPLATE).valve is None
    valve = below_base(imaging, (landmark(10.0),), TEMPLATE).valve
    assert valve is not None
    places = MIDDLE + np.outer([-30.0, 8.0, 18.0], AXES[:, 2])
    assert (places @ valve[0] <= valve[1]).tolist() == [True, True, False]


SHAPE = (27, 27, 35)
AFFINE = np.column_stack([3.0 * np.eye(3), MIDDLE - 1.5 * (np.array(SHAPE) - 1)])
FULL = volume(affine=AFFINE, shape=SHAPE)


def without_blood(height: float) -> Volume:
    """The wall as it was, and no blood in the lowest so many mm."""
    index = np.stack(np.meshgrid(*map(np.arange, SHAPE), indexing="ij"), axis=-1)
    local = (index @ AFFINE[:, :3].T + AFFINE[:, 3] - MIDDLE) @ AXES
    inside = np.linalg.norm(local / [RADIUS + 1.0, RADIUS + 1.0, LENGTH + 1.0], axis=-1) < 1.0
    gone = inside & (local[..., 2] < height - LENGTH)
    return Volume(np.where(gone, 40.0, FULL.values), AFFINE)


def test_the_tip_stays_where_blood_leaves_it_unless_an_apex_is_stated() -> None:
    images = ImageSequence((FULL, without_blood(7.0), without_blood(14.0)))
    rises = []
    for apex in (LANDMARKS["apex"], LANDMARKS["apex"] + np.outer([0.0, 7.0, 14.0], AXES[:, 2])):
        marks = {"apex": apex, "base": np.tile(BASE, (3, 1))}
        result = track(images, landmarks=marks, modes=18, time="open")
        x = result.sequence.vertices[:, :64].mean(axis=1)
        rises.append(float((x[2] - x[0]) @ AXES[:, 2]))
    assert rises[0] < 8.0
    assert rises[1] > 11.0


@pytest.mark.every(2)
def test_one_statement_of_the_base_is_enough_for_an_interval_that_holds() -> None:
    # Bright on beyond the cut, as an atrium is, and nothing tells where it begins.
    images = ImageSequence((volume(22.0), volume(17.0), volume(20.0)))
    once = np.full((3, 3), np.nan)
    once[0] = BASE
    result = track(images, landmarks={"apex": LANDMARKS["apex"], "base": once})
    true = np.array([enclosed(radius) for radius in (22.0, 17.0, 20.0)])
    assert result.volumes is not None
    assert result.volume_deviations is not None
    # The base of these stands still, the least that a valve does.
    assert (np.abs(result.volumes - true) < 2.2 * result.volume_deviations).all()
    assert result.volume_deviations[1] > 1.1 * result.volume_deviations[0]


def test_errors_of_the_base_are_known_of_few_rings() -> None:
    # The last of a dozen rings is at 0.96 of the way from apex to base.
    beat = simulate_ventricle(grid=(12, 16), acquisition=Acquisition(n_frames=3))
    found = track(beat, start=beat, modes=4, reference=None)
    assert np.isfinite(found.deviations).all()
    assert found.volume_deviations is not None
    assert (found.volume_deviations > 0).all()
