"""What a millimetre of each mode does to a read-out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modalmotion.clinical import clinical_readouts
from modalmotion.clinical.sensitivity import sensitivities
from modalmotion.clinical.strain import wall_strain
from modalmotion.mesh import cavity_of
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import reconstruct
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion.template import make_template
from modalmotion.template.body_frame import Components

BEAT = simulate_ventricle(
    grid=(24, 48), acquisition=Acquisition(n_frames=8, noise=0.3), rng=np.random.default_rng(5)
)


@pytest.mark.parametrize("components", list(Components))
def test_gradients_are_finite_differences(components: Components) -> None:
    signature = modal_signature(BEAT, SignatureParameters(modes=4, components=components))
    readouts = clinical_readouts(signature, BEAT)
    found = sensitivities(signature, BEAT, readouts)
    start, end = readouts.curve.end_diastole, readouts.curve.end_systole
    template = make_template(BEAT)
    cavity = cavity_of(BEAT.faces, BEAT.n_vertices)

    def read(amplitudes: np.ndarray) -> np.ndarray:
        moved = reconstruct(replace(signature, amplitudes=amplitudes), BEAT, [start, end])
        large, small = np.abs(cavity.volume(moved)) / 1000.0
        still = replace(BEAT, vertices=moved, times=None)
        strain = wall_strain(still, template, 0, 1)
        return np.array([small, 100.0 * (1.0 - small / large), *strain.curves[1, :3]])

    assert found.names[1:] == ("end_systolic_volume", "ejection_fraction", "GLS", "GCS", "GAS")
    for mode, direction in ((1, 2), (2, 0), (3, 1)):
        sides = []
        for step in (0.1, -0.1):
            amplitudes = signature.amplitudes.copy()
            amplitudes[end, mode, direction] += step
            sides.append(read(amplitudes))
        difference = (sides[0] - sides[1]) / 0.2
        np.testing.assert_allclose(
            found.values[1:, mode, direction], difference, rtol=0.01, atol=0.02
        )
