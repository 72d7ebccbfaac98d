"""Names of waves follow from how they moved."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from modalmotion.mesh.sequence import mesh_sequence, standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CUP
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import fitted_on
from modalmotion.template.body_frame import Components
from modalmotion.viewer.payload import wave_name

STILL = standard_surface(Lattice(CUP, (16, 24)))


def moved(x: NDArray[np.float64], kind: str, share: float) -> NDArray[np.float64]:
    """Deform the surface about its axis, z."""
    y = x.copy()
    if kind == "radial contraction":
        y[:, :2] *= 1.0 - share
    elif kind == "longitudinal shortening":
        y[:, 2] *= 1.0 - share
    elif kind == "twist":
        angle = share * (x[:, 2] - x[:, 2].min())
        y[:, 0] = np.cos(angle) * x[:, 0] - np.sin(angle) * x[:, 1]
        y[:, 1] = np.sin(angle) * x[:, 0] + np.cos(angle) * x[:, 1]
    elif kind == "ovalisation":
        y[:, 0] *= 1.0 - share
        y[:, 1] *= 1.0 + share
    elif kind == "bending":
        y[:, 0] += share * (x[:, 2] - x[:, 2].mean()) ** 2
    return y


@pytest.mark.parametrize("turn", [0.0, 0.7])
@pytest.mark.parametrize(
    ("kind", "wavenumbers"),
    [
        ("radial contraction", (0, 1)),
        ("ovalisation", (0, 1)),
        ("longitudinal shortening", (1, 0)),
        ("twist", (1, 1)),
    ],
)
def test_a_pure_motion_names_its_wave(kind: str, wavenumbers: tuple[int, int], turn: float) -> None:
    x = np.asarray(STILL.vertices[0], dtype=np.float64)
    R = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    frames = [moved(x, kind, share) @ R.T for share in (0.0, 0.1, 0.2, 0.1)]
    sequence = mesh_sequence(np.stack(frames), grid=STILL.grid, topology=CUP, unit="mm")
    signature = modal_signature(sequence)
    template = fitted_on(signature, sequence)
    places = [k for k, la in enumerate(signature.modes.labels) if la.wavenumbers == wavenumbers]
    assert wave_name(signature, template, places).startswith(kind)
    local = modal_signature(sequence, SignatureParameters(components=Components.CYLINDRICAL))
    if kind == "radial contraction":
        assert wave_name(local, template, [0]) == kind


def test_a_wave_that_does_not_move_is_named_by_all_that_it_may_be() -> None:
    still = np.repeat(STILL.vertices[:1], 3, axis=0)
    sequence = mesh_sequence(still, grid=STILL.grid, topology=CUP, unit="mm")
    signature = modal_signature(sequence)
    name = wave_name(signature, fitted_on(signature, sequence), [2, 3])
    assert name == "radial contraction, twist, ovalisation"
