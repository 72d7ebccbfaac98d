"""A bull's-eye for print."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.patches import Wedge

from modalmotion.clinical.segments import RINGS, SEGMENTS, RegionalMotion
from modalmotion.pictures.readouts import bulls_eye_figure


def motion(names: tuple[str, ...], reason: str = "") -> RegionalMotion:
    shares = np.stack([np.zeros(len(names)), np.arange(len(names)) + 1.0])
    return RegionalMotion(names, shares, 0, reason, "0" * 64)


@pytest.mark.parametrize("names", [SEGMENTS, RINGS])
def test_segments_fill_the_disc_and_bear_their_numbers(names: tuple[str, ...]) -> None:
    figure = bulls_eye_figure(motion(names, "" if len(names) == 17 else "Rings only."))
    axes = figure.axes[0]
    wedges = [patch for patch in axes.patches if isinstance(patch, Wedge)]
    areas = []
    for wedge in wedges:
        inner = wedge.r - float(wedge.width or 0.0)
        areas.append(np.radians(wedge.theta2 - wedge.theta1) / 2 * (wedge.r**2 - inner**2))
    assert len(wedges) == len(names)
    assert sum(areas) == pytest.approx(np.pi)
    assert {text.get_text() for text in axes.texts} >= {str(n + 1) for n in range(len(names))}
    # The one that has moved most is the brightest.
    assert np.argmax([sum(w.get_facecolor()[:2]) for w in wedges]) == len(names) - 1
    assert "frame 1" in axes.get_title()


def test_walls_lie_where_the_standard_has_them() -> None:
    axes = bulls_eye_figure(motion(SEGMENTS)).axes[0]
    at = {text.get_text(): text.get_position() for text in axes.texts}
    assert at["anterior"][1] > 1.0
    assert at["septal"][0] < -1.0
    # Segment 2, basal anteroseptal, is above on the left.
    assert at["2"][0] < -0.5
    assert at["2"][1] > 0.3


def test_a_segment_without_vertices_has_no_number() -> None:
    made = motion(SEGMENTS)
    made.shares[:, 3] = np.nan
    figure = bulls_eye_figure(made)
    assert "–" in {text.get_text() for text in figure.axes[0].texts}
