"""The picture of natural coordinates."""

from __future__ import annotations

import io

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from template_surfaces import MAKERS, make_ventricle

from modalmotion.errors import TopologyError
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.template import make_template


@pytest.mark.every(3)
@pytest.mark.parametrize("topology", sorted(MAKERS))
def test_both_coordinates_from_both_sides(topology: str) -> None:
    from modalmotion.pictures.modes import template_figure

    sequence = mesh_sequence(*MAKERS[topology](200, np.random.default_rng(0)), topology=topology)
    template = make_template(sequence)
    figure = template_figure(template)
    panels = [axis for axis in figure.axes if axis.name == "3d"]
    assert len(panels) == 4
    assert len(figure.axes) == 6
    assert all("front" in p.get_title() or "back" in p.get_title() for p in panels)
    # In red the triangles at theta = 0 where there is one.
    red = [
        (np.asarray(panel.collections[0].get_facecolor())[:, :3] == to_rgb("#d62728"))
        .all(axis=1)
        .sum()
        for panel in panels
    ]
    assert (max(red) > 0) == bool(template.topology.closed_axes)
    assert max(red) < 0.3 * len(template.faces)
    buffer = io.BytesIO()
    figure.savefig(buffer)
    assert buffer.getvalue().startswith(b"\x89PNG")


def test_the_colours_are_the_coordinates() -> None:
    from modalmotion.pictures.modes import template_figure

    template = make_template(mesh_sequence(*make_ventricle(300, np.random.default_rng(0))))
    panel = template_figure(template).axes[0]
    shown = len(panel.collections[0].get_facecolor())
    assert 0.3 * len(template.faces) < shown < 0.7 * len(template.faces)


def test_surfaces_without_natural_coordinates_have_none() -> None:
    from modalmotion.pictures.modes import template_figure

    vertices, faces = make_ventricle(200, np.random.default_rng(0))
    springs = make_template(mesh_sequence(vertices, faces), closed_form=False)
    with pytest.raises(TopologyError, match="No natural coordinates"):
        template_figure(springs)
    curve = make_template(mesh_sequence(vertices[:, :9], topology="open curve"))
    with pytest.raises(TopologyError, match="no triangles"):
        template_figure(curve)
