"""A bar of a stated length, and the axes of the file, below a surface."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from modalmotion.pictures.views import draw_scale, round_length


@pytest.mark.parametrize(
    ("longest", "chosen"),
    [(1.0, 1.0), (0.99, 0.5), (7.0, 5.0), (4.9, 2.0), (3e-7, 2e-7), (1.9e150, 1e150)],
)
def test_a_bar_has_a_round_length(longest: float, chosen: float) -> None:
    assert round_length(longest) == pytest.approx(chosen, rel=1e-12)


def drawn(size: float, unit: str | None, coordinates: str, azimuth: float) -> Any:
    axes: Any = Figure().add_subplot(projection="3d")
    box = np.array([[-0.5, -0.3, -1.0], [0.5, 0.3, 1.0]])
    view = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    draw_scale(axes, box, view, size=size, unit=unit, coordinates=coordinates, azimuth=azimuth)
    return axes


@pytest.mark.parametrize(
    ("size", "unit", "text"),
    [(50.0, "mm", "20 mm"), (0.05, "m", "0.02 m"), (3e-150, None, "2 1e-150 length units")],
)
@pytest.mark.parametrize("azimuth", [-90.0, -70.0])
def test_the_bar_is_as_long_as_it_says(
    size: float, unit: str | None, text: str, azimuth: float
) -> None:
    axes = drawn(size, unit, "unknown", azimuth)
    (said, *_) = [one.get_text() for one in axes.texts]
    assert said == text
    ends = np.array(axes.lines[0].get_data_3d()).T
    stated = float(said.split()[0]) * (1e-150 if unit is None else 1.0)
    assert np.linalg.norm(ends[1] - ends[0]) * size == pytest.approx(stated)
    # Across the line of sight, and below all that is seen.
    sight = [np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth)), 0.0]
    assert (ends[1] - ends[0]) @ sight == pytest.approx(0.0, abs=1e-12)
    assert ends[:, 2].max() < -1.0


@pytest.mark.parametrize(
    ("coordinates", "letters"), [("unknown", "xyz"), ("LPS", "LPS"), ("RAS", "RAS")]
)
def test_axes_point_where_the_file_s_do(coordinates: str, letters: str) -> None:
    axes = drawn(50.0, "mm", coordinates, -90.0)
    assert [one.get_text() for one in axes.texts[1:]] == list(letters)
    # The file's x is up here.
    ends = np.array(axes.lines[1].get_data_3d()).T
    step = ends[1] - ends[0]
    assert step / np.linalg.norm(step) == pytest.approx([0.0, 0.0, 1.0])
