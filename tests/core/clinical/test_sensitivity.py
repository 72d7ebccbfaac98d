"""What a millimetre of each mode does to a read-out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy

from modalmotion.clinical import clinical_readouts
from modalmotion.clinical.dyssynchrony import dyssynchrony, phases_of, sectors_of, segment_volumes
from modalmotion.clinical.smooth_wall import smooth_walls
from modalmotion.clinical.strain import wall_strain
from modalmotion.clinical.ventricle import sensitivities
from modalmotion.clinical.wall_motion import WallMotion
from modalmotion.mesh import cavity_of
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import reconstruct
from modalmotion.simulate import Acquisition, MotionClass, draw_parameters, simulate_ventricle
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

    assert found.names[1:6] == ("end_systolic_volume", "ejection_fraction", "GLS", "GCS", "GAS")
    for mode, direction in ((1, 2), (2, 0), (3, 1)):
        sides = []
        for step in (0.1, -0.1):
            amplitudes = signature.amplitudes.copy()
            amplitudes[end, mode, direction] += step
            sides.append(read(amplitudes))
        difference = (sides[0] - sides[1]) / 0.2
        np.testing.assert_allclose(
            found.values[1:6, mode, direction], difference, rtol=0.01, atol=0.02
        )


def test_the_gradient_of_dyssynchrony_is_a_finite_difference() -> None:
    rng = np.random.default_rng(9)
    parameters = draw_parameters(MotionClass.DYSSYNCHRONY, rng)
    frames = Acquisition(n_frames=25)
    beat = simulate_ventricle(parameters, grid=(16, 32), acquisition=frames, rng=rng)
    signature = modal_signature(beat, SignatureParameters(modes=7))
    readouts = clinical_readouts(signature, beat)
    found = sensitivities(signature, beat, readouts)
    values = found.values[found.names.index("SDI")]
    curve, wall = readouts.curve, smooth_walls(make_template(beat), is_lattice=True)[0]

    def volumes(amplitudes: np.ndarray) -> np.ndarray:
        moved = reconstruct(replace(signature, amplitudes=amplitudes), beat)
        motion = WallMotion.of(moved, None, wall, curve.end_diastole)
        return segment_volumes(motion, sectors_of(motion), 16)[0]

    phases = phases_of(beat)

    def index(amplitudes: np.ndarray) -> float:
        times = []
        for volume in volumes(amplitudes).T:
            closed = np.append(volume, volume[0])
            spline = scipy.interpolate.CubicSpline([*phases, 1.0], closed, bc_type="periodic")
            level = spline.derivative().roots(extrapolate=False)
            times.append(level[spline(level).argmin()])
        return float(100.0 * np.std(times, ddof=1))

    stated = dyssynchrony(volumes(signature.amplitudes), phases, np.zeros((25, 16)))
    assert stated is not None
    assert index(signature.amplitudes) == pytest.approx(stated[0], abs=0.1)
    at_start, at_end = curve.volumes[[curve.end_diastole, curve.end_systole]]
    # A larger step may make another minimum of a segment the lowest.
    course = 0.01 * (at_start - curve.volumes) / (at_start - at_end)
    for mode, direction in (1, 2), (2, 0), (3, 1):
        sides = []
        for sign in (1.0, -1.0):
            amplitudes = signature.amplitudes.copy()
            amplitudes[:, mode, direction] += sign * course
            sides.append(index(amplitudes))
        difference = (sides[0] - sides[1]) / 0.02
        largest = np.abs(values).max()
        assert values[mode, direction] == pytest.approx(difference, rel=0.01, abs=0.01 * largest)
