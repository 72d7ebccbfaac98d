"""Frequencies of waves of a stated speed, and the speeds that no waves have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.mesh.standard_surfaces import standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topology import CYLINDER
from modalmotion.template import Template, make_template
from modalmotion.template.vibration_modes import surface_modes


@pytest.fixture(scope="module")
def tube() -> Template:
    return make_template(standard_surface(Lattice(CYLINDER, (24, 48))))


@pytest.fixture(scope="module")
def two_pieces() -> Template:
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    x = np.random.default_rng(0).normal(size=(1, 8, 3))
    return make_template(mesh_sequence(x, np.concatenate([faces, faces + 4])))


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan"), float("inf"), 1e101])
def test_no_waves_have_such_a_speed(tube: Template, two_pieces: Template, speed: float) -> None:
    for template in (tube, two_pieces):
        with pytest.raises(ParameterError, match="wave speed") as error:
            surface_modes(template, 4, wave_speed=speed)
        assert "at most 1e+100" in str(error.value.remedy)


def test_frequencies_beyond_the_largest_number_are_refused(tube: Template) -> None:
    small = replace(tube, lengths=tuple(1e-250 * length for length in tube.lengths))
    with pytest.raises(ParameterError, match="beyond the largest number"):
        surface_modes(small, 4, wave_speed=1e100)
    surface_modes(small, 4)
