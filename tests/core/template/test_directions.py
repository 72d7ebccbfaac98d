"""Directions on surfaces: normals point outward, whatever the winding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modalmotion.errors import TopologyError
from modalmotion.mesh.sequence import standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CLOSED_CURVE, CYLINDER, PLANE, SPHERE, TORUS
from modalmotion.template import Template, make_template
from modalmotion.template.body_frame import Direction, directions_on


def template_of(lattice: Lattice, scale: float = 1.0) -> Template:
    surface = standard_surface(lattice)
    return make_template(replace(surface, vertices=scale * surface.vertices))


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
@pytest.mark.parametrize("turned_over", [False, True])
def test_normals_of_a_sphere_are_its_radii(scale: float, turned_over: bool) -> None:
    template = template_of(Lattice(SPHERE, (20, 40)), scale)
    if turned_over:
        template = replace(template, faces=template.faces[:, ::-1].copy())
    normals = directions_on(template, Direction.NORMAL)
    # The hole at a pole tilts them by 5 degrees there.
    assert (normals * (template.vertices / scale)).sum(axis=1).min() > np.cos(np.radians(5))
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)


def test_normals_of_a_torus_point_away_from_its_tube() -> None:
    template = template_of(Lattice(TORUS, (16, 32)))
    x = template.vertices
    ring = x * [1.0, 1.0, 0.0]
    ring /= np.linalg.norm(ring, axis=1, keepdims=True)
    away = (directions_on(template, Direction.NORMAL) * (x - ring)).sum(axis=1)
    assert away == pytest.approx(np.linalg.norm(x - ring, axis=1), rel=0.02)


def test_directions_of_a_cylinder_are_those_of_its_axis() -> None:
    template = template_of(Lattice(CYLINDER, (8, 16)))
    frames = [
        directions_on(template, d)
        for d in (Direction.RADIAL, Direction.TANGENTIAL, Direction.AXIAL)
    ]
    for a in range(3):
        for b in range(3):
            assert (frames[a] * frames[b]).sum(axis=1) == pytest.approx(float(a == b), abs=1e-12)
    assert frames[0] == pytest.approx(template.vertices * [1, 1, 0], abs=1e-12)
    inner = slice(16, -16)
    normals = directions_on(template, Direction.NORMAL)
    assert normals[inner] == pytest.approx(frames[0][inner], abs=1e-12)
    assert (directions_on(template, Direction.Z) == [0, 0, 1]).all()


def test_directions_that_a_surface_does_not_have() -> None:
    with pytest.raises(TopologyError, match="x, y or z"):
        directions_on(template_of(Lattice(CLOSED_CURVE, (9,))), Direction.NORMAL)
    with pytest.raises(TopologyError):
        directions_on(template_of(Lattice(PLANE, (4, 6))), Direction.RADIAL)
    band = template_of(Lattice(CYLINDER, (2, 12)))
    faces = band.faces.copy()
    # A Moebius band: where the strip closes, top meets bottom.
    last = np.isin(faces % 12, [0, 11]).any(axis=1) & (np.ptp(faces % 12, axis=1) > 1)
    faces[last] = np.where(faces[last] % 12 == 0, (faces[last] + 12) % 24, faces[last])
    with pytest.raises(TopologyError, match="one-sided"):
        directions_on(replace(band, faces=faces), Direction.NORMAL)
