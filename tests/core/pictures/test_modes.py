"""Pictures of modes: a panel each, of a finite surface from any side."""

from __future__ import annotations

import io

import pytest

from modalmotion.mesh.sequence import standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CLOSED_CURVE, PLANE, TORUS, Topology
from modalmotion.pictures.modes import modes_figure
from modalmotion.template import make_template
from modalmotion.template.vibration_modes import lattice_modes


@pytest.mark.every(3)
@pytest.mark.parametrize(
    ("topology", "shape"), [(TORUS, (6, 8)), (PLANE, (4, 6)), (CLOSED_CURVE, (40,))], ids=str
)
def test_each_mode_has_its_panel_up_to_24(topology: Topology, shape: tuple[int, ...]) -> None:
    lattice = Lattice(topology, shape)
    template = make_template(standard_surface(lattice))
    few = modes_figure(template, lattice_modes(lattice, 3))
    titles = [axes.get_title() for axes in few.axes if axes.get_title()]
    assert [title.split("\n")[0] for title in titles] == [
        str(label) for label in lattice_modes(lattice, 3).labels
    ]
    if topology == CLOSED_CURVE:
        many = modes_figure(template, lattice_modes(lattice, 29))
        assert len([axes for axes in many.axes if axes.get_title()]) == 24
        assert "the first 24 of 29" in many.get_suptitle()
    buffer = io.BytesIO()
    few.savefig(buffer, format="png", dpi=30)
    assert buffer.getvalue().startswith(b"\x89PNG")
