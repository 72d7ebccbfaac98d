"""Pictures of a track: its points over it, its stated error, what was determined."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from clouds import breathing_spheroid, sampled
from matplotlib.figure import Figure

from modalmotion.errors import ParameterError, TopologyError
from modalmotion.pictures.track import data_figure, determined_figure, deviations_figure
from modalmotion.tracking import Track, track


@pytest.fixture(scope="module")
def found() -> Track:
    beat, rng = breathing_spheroid(4), np.random.default_rng(0)
    clouds = [sampled(x, beat.faces, 150, rng, 0.3) for x in beat.vertices]
    clouds[1][:8] *= 1.7
    return track([*clouds[:2], None, clouds[3]], modes=7, unit="mm")


def drawn(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=30)
    return buffer.getvalue()


def test_points_lie_over_the_surface_of_each_frame(found: Track) -> None:
    figure = data_figure(found)
    assert [axes.get_title() for axes in figure.axes] == [
        "frame 0",
        "frame 1",
        "frame 2 (nothing seen)",
        "frame 3",
    ]
    assert "mm; " in figure.get_suptitle()
    assert "of 450 points are outliers" in figure.get_suptitle()
    assert drawn(figure).startswith(b"\x89PNG")


def test_a_track_without_its_data_says_so(found: Track) -> None:
    with pytest.raises(ParameterError, match="not contain the data"):
        data_figure(replace(found, data=None))


def test_stated_error_is_drawn_across_the_surface_and_along_it(found: Track) -> None:
    figure = deviations_figure(found, 1)
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels.count("standard deviation (mm)") == 2
    assert drawn(figure).startswith(b"\x89PNG")


def test_share_of_each_mode_that_the_data_set(found: Track) -> None:
    figure = determined_figure(found)
    heights = [patch.get_height() for patch in figure.axes[0].patches]  # type: ignore[attr-defined]
    assert heights == pytest.approx(100 * found.determined.T.ravel())
    assert "of 7 modes" in figure.axes[0].get_title()


def test_curves_have_no_surface_to_draw_on() -> None:
    t = np.linspace(0, 6.2, 60)
    ring = np.stack([20 * np.cos(t), 15 * np.sin(t), 0 * t], axis=1)
    curve = track([ring, 0.9 * ring], topology="closed curve", modes=3)
    with pytest.raises(TopologyError, match="curve"):
        deviations_figure(curve, 0)
