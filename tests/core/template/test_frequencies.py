"""Frequencies of waves of a stated speed, and the speeds that no waves have."""

from __future__ import annotations

from dataclasses import replace

import pytest

from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CYLINDER
from modalmotion.template import make_template
from modalmotion.template.vibration_modes import surface_modes

TUBE = make_template(standard_surface(Lattice(CYLINDER, (6, 8))))


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan"), float("inf"), 1e101])
def test_no_waves_have_such_a_speed(speed: float) -> None:
    with pytest.raises(ParameterError, match="wave speed") as error:
        surface_modes(TUBE, 4, wave_speed=speed)
    assert "at most 1e+100" in str(error.value.remedy)


def test_frequencies_beyond_the_largest_number_are_refused() -> None:
    small = replace(TUBE, lengths=tuple(1e-250 * length for length in TUBE.lengths))
    with pytest.raises(ParameterError, match="frequencies that overflow"):
        surface_modes(small, 4, wave_speed=1e100)
    surface_modes(small, 4)
