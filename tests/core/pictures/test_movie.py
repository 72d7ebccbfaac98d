"""Frames of a moving surface as pictures: they differ where it moves, and play as GIF."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image, ImageSequence

from modalmotion.mesh.sequence import standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CLOSED_CURVE, CYLINDER, PLANE, Topology
from modalmotion.pictures.modes import Extent, draw_frames, write_gif
from modalmotion.template import make_template


@pytest.mark.parametrize(
    ("topology", "shape"), [(CYLINDER, (4, 8)), (PLANE, (4, 4)), (CLOSED_CURVE, (12,))], ids=str
)
def test_frames_show_the_motion(topology: Topology, shape: tuple[int, ...]) -> None:
    template = make_template(standard_surface(Lattice(topology, shape)))
    heights = [np.zeros(len(template.vertices)), np.linspace(0.0, 0.5, len(template.vertices))]
    positions = [template.vertices + h[:, None] * [0.0, 0.0, 1.0] for h in heights]
    extent = Extent(template, positions, heights)
    assert extent.largest == 0.5
    still, moved, still_again = draw_frames(
        template, [*positions, positions[0]], [*heights, heights[0]], extent
    )
    assert still.shape == moved.shape == (480, 480, 3)
    assert np.array_equal(still, still_again)
    assert (still != moved).any()
    assert (still < 250).any()
    with Image.open(io.BytesIO(write_gif(iter([still, moved]), 0.04))) as gif:
        assert (gif.format, gif.info["duration"]) == ("GIF", 40)
        assert len([*ImageSequence.Iterator(gif)]) == 2
