"""A base that few frames state: held where valves go, its error stated, nothing beyond it seen."""

from __future__ import annotations

import numpy as np
import pytest
from ellipsoid_images import AXES, BASE, CUT, LANDMARKS, LENGTH, MIDDLE, enclosed, spheroid, volume

from modalmotion.images import ImageSequence
from modalmotion.images.edges import Levels
from modalmotion.tracking import Observation, track
from modalmotion.tracking.image_frames import below_base, with_base
from modalmotion.tracking.image_view import Sight

TEMPLATE = spheroid()
HEIGHT = CUT + LENGTH


def landmark(height: float, sd: float | None = None) -> Observation:
    place = MIDDLE + height * AXES[:, 2]
    return Observation(place[None], sd=sd, places=("base",))


def base_of(frame: tuple[Observation, ...]) -> np.ndarray:
    (own,) = (part for part in frame if part.places == ("base",))
    return np.asarray(own.points[0])


def test_what_is_stated_stays_and_the_rest_is_where_valves_go() -> None:
    stated = ((landmark(CUT),), (landmark(CUT - 9.0),), ())
    marks, variances = with_base(stated, TEMPLATE, 0)
    assert marks[:2] == stated[:2]
    heights = [(base_of(frame) - MIDDLE) @ AXES[:, 2] for frame in marks]
    # What is usual is a tenth of the length down.
    assert heights == pytest.approx([CUT, CUT - 9.0, CUT - 0.1 * HEIGHT], abs=1.0)
    assert variances[:2].tolist() == [0.0, 0.0]
    # Two deviations reach from no descent to a fifth.
    assert 0.08 * HEIGHT < 2.0 * variances[2] ** 0.5 < 0.15 * HEIGHT


def test_edges_beyond_the_base_do_not_count() -> None:
    sight = Sight(Levels(100.0, 0.0, 1.0), np.zeros(3), MIDDLE, np.zeros((1, 3)))
    assert below_base(sight, (), TEMPLATE).valve is None
    valve = below_base(sight, (landmark(10.0),), TEMPLATE).valve
    assert valve is not None
    places = MIDDLE + np.outer([-30.0, 8.0, 18.0], AXES[:, 2])
    assert valve.are_below(places).tolist() == [True, True, False]


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
    assert result.volume_deviations[1] > 1.5 * result.volume_deviations[0]
