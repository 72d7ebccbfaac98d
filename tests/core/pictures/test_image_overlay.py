"""Contours over slices: they lie on the edge that the slice shows."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from ellipsoid_images import LANDMARKS, RADIUS, planes, volume

from modalmotion.images import ImageSequence, PlaneSet, Volume
from modalmotion.mesh.geometry import Edges
from modalmotion.pictures.track import contours_in, overlay_figure
from modalmotion.tracking import track


@pytest.mark.every(2)
@pytest.mark.parametrize("image", [planes(), volume()], ids=["planes", "volume"])
def test_every_phase_is_drawn(image: PlaneSet | Volume) -> None:
    images = ImageSequence((image,))
    result = track(images, landmarks=LANDMARKS, modes=7)
    figure = overlay_figure(result, images)
    assert len(figure.axes) == (4 if isinstance(image, PlaneSet) else 3)
    assert all(axes.lines for axes in figure.axes)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=30)
    assert buffer.getvalue().startswith(b"\x89PNG")
    if isinstance(image, PlaneSet):
        # Next to the middle the slice is a circle of pixels.
        plane = image.planes[3]
        x = result.sequence.vertices[0].astype(np.float64)
        contour = contours_in(plane, x, Edges.of(result.template.faces), np.zeros(3))
        radii = np.linalg.norm(contour.reshape(-1, 2) - 29.5, axis=1) * 1.5
        assert radii == pytest.approx(RADIUS, abs=1.5)
        aside = contours_in(plane, x, Edges.of(result.template.faces), 3.0 * plane.affine[:, 0])
        assert aside == pytest.approx(np.add(contour, (3.0, 0.0)))


def test_slices_beside_the_surface_are_not_drawn() -> None:
    own = planes()
    first = own.planes[0]
    far = [
        replace(first, affine=first.affine + np.outer(height * first.normal, [0.0, 0.0, 1.0]))
        for height in (-60.0, -50.0, -40.0, 110.0, 120.0)
    ]
    images = ImageSequence((PlaneSet((*far, *own.planes)),))
    figure = overlay_figure(track(images, landmarks=LANDMARKS, modes=7), images)
    assert len(figure.axes) == 4
    assert all(axes.lines for axes in figure.axes)
