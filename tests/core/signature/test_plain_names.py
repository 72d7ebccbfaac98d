"""Words beside the labels of modes."""

from __future__ import annotations

import pytest

from modalmotion.modes import lowest_modes
from modalmotion.modes.topologies import (
    CLOSED_CURVE,
    CUP,
    CYLINDER,
    OPEN_CURVE,
    PLANE,
    SPHERE,
    TORUS,
    ModeLabel,
    Topology,
)
from modalmotion.signature.mode_names import plain_name
from modalmotion.template.body_frame import Components


@pytest.mark.parametrize(
    "topology", [CLOSED_CURVE, CUP, CYLINDER, OPEN_CURVE, PLANE, SPHERE, TORUS]
)
@pytest.mark.parametrize("components", list(Components))
def test_every_wave_has_a_name_of_its_own(topology: Topology, components: Components) -> None:
    labels = lowest_modes(topology, 60).labels
    names = {label.wavenumbers: plain_name(topology, label, components) for label in labels}
    assert all(names.values())
    assert len(set(names.values())) == len(names)


def test_names_say_what_the_components_make_of_a_mode() -> None:
    whole, round_ = ModeLabel((0, 0), "cos"), ModeLabel((0, 1), "cos")
    assert plain_name(CUP, whole) == "translation"
    assert "contraction" in plain_name(CUP, round_)
    assert "contraction" in plain_name(CUP, whole, Components.CYLINDRICAL)
    assert plain_name(CUP, whole, along_normal=True) == "all outward or all inward"
    assert plain_name(CUP, ModeLabel((3, 2), "sin")) == "3 half waves along, 2 waves around"
    assert plain_name(None, ModeLabel((4,), "spring")) == "shape 4 of this mesh"
