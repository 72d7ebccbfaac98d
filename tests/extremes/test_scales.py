"""Whatever is asked of a sequence does not depend on its length unit, to the ends of float64."""

from __future__ import annotations

import io
from collections.abc import Callable

import numpy as np
import pytest

import modalmotion as mm
from modalmotion.codec import decode, encode
from modalmotion.exports.signature_pack import SurfaceFormat, write_superposed
from modalmotion.formats import read_npz, write_raw
from modalmotion.mesh import lattice_faces
from modalmotion.modes.topologies import CYLINDER
from modalmotion.pictures.modes import template_figure
from modalmotion.pictures.signature import tradeoff_figure
from modalmotion.signature import measure_tradeoff
from modalmotion.signature.distance import compare

GRID = (12, 16)
# Of every scale, and of the two that are farthest away; the others are for long counts.
FARTHEST = [1e-300, 1e300]
BETWEEN = [pytest.param(scale, marks=pytest.mark.soak) for scale in (1e-200, 1e200)]
SCALES = [*FARTHEST, 1e-160, 1e160, *BETWEEN]


def scaled(scale: float, seed: int = 1) -> mm.MeshSequence:
    beat = mm.simulate_ventricle(
        grid=GRID, acquisition=mm.Acquisition(noise=0.3), rng=np.random.default_rng(seed)
    )
    return mm.mesh_sequence(beat.vertices * scale, grid=GRID, topology="cup", unit="mm")


def signature(scale: float, **asked: object) -> mm.ModalSignature:
    return mm.modal_signature(scaled(scale), mm.SignatureParameters(**asked))  # type: ignore[arg-type]


# What is a length is given over the scale.
ASKED: dict[str, Callable[[float], list[np.ndarray | float]]] = {
    "cylindrical components": lambda s: [
        (found := signature(s, components="cylindrical")).amplitudes / s,
        found.rms_errors / s,
    ],
    "auto": lambda s: [
        len((found := signature(s, auto=True)).modes),
        found.rms_error / s,
    ],
    "a tolerance": lambda s: [
        len((found := signature(s, tolerance=1.0 * s)).modes),
        found.max_error / s,
    ],
    "the mean shape": lambda s: [signature(s, reference="mean").amplitudes / s],
    "closure and distance": lambda s: [
        (found := signature(s)).closure_gap,
        compare(found, mm.modal_signature(scaled(s, seed=2))).distance,
    ],
    "the trade": lambda s: [
        np.array(measure_tradeoff(scaled(s), most_modes=12).front.branches[0].rms) / s
    ],
    "surfaces": lambda s: [
        read_npz(write_superposed(signature(s), scaled(s), SurfaceFormat.NPZ)).sequence.vertices / s
    ],
}


@pytest.fixture(scope="module")
def usual() -> dict[str, list[np.ndarray | float]]:
    return {name: ask(1.0) for name, ask in ASKED.items()}


@pytest.mark.every(3)
@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("name", ASKED)
def test_the_answer_is_that_of_the_usual_unit(
    name: str, scale: float, usual: dict[str, list[np.ndarray | float]]
) -> None:
    for found, expected in zip(ASKED[name](scale), usual[name], strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("scale", SCALES)
def test_springs_of_a_mesh_without_coordinates_are_those_of_the_usual_unit(scale: float) -> None:
    beat = mm.simulate_ventricle(grid=GRID)
    # Two pieces are of no topology.
    vertices = np.concatenate([beat.vertices, beat.vertices + 100.0], axis=1)
    one = lattice_faces(CYLINDER, GRID)
    faces = np.concatenate([one, one + beat.n_vertices])
    found, usual = (
        mm.modal_signature(mm.mesh_sequence(vertices * s, faces=faces)) for s in (scale, 1.0)
    )
    assert found.surface == "mesh"
    frequencies = found.angular_frequencies * scale
    np.testing.assert_allclose(frequencies, usual.angular_frequencies, rtol=1e-9)
    np.testing.assert_allclose(found.rms_errors / scale, usual.rms_errors, rtol=1e-9)


@pytest.mark.every(2)
@pytest.mark.parametrize("scale", SCALES)
def test_a_stream_keeps_its_word(scale: float) -> None:
    sequence = scaled(scale)
    found = encode(sequence, rms=0.05 * scale)
    left = (decode(found.data).vertices - sequence.vertices) / scale
    rms = float(np.sqrt((left**2).sum(axis=2).mean()))
    assert rms <= 0.05
    assert found.rms / scale == pytest.approx(rms, rel=1e-9, abs=1e-300)


@pytest.mark.every(2)
@pytest.mark.parametrize("scale", FARTHEST)
def test_fields_and_pictures_are_written(scale: float) -> None:
    sequence = scaled(scale)
    own = mm.modal_signature(sequence)
    assert write_superposed(own, sequence, SurfaceFormat.VTKHDF)
    template, trade = mm.make_template(sequence), measure_tradeoff(sequence, most_modes=12)
    for figure in (template_figure(template), tradeoff_figure(trade)):
        figure.savefig(io.BytesIO(), dpi=30)


@pytest.mark.parametrize("scale", [1e90, 1e200, 1e300])
def test_what_single_precision_cannot_hold_is_refused(scale: float) -> None:
    sequence = scaled(scale)
    writers: tuple[Callable[[], object], ...] = (
        lambda: write_raw(sequence),
        lambda: write_superposed(mm.modal_signature(sequence), sequence, SurfaceFormat.GLB),
    )
    for write in writers:
        with pytest.raises(
            mm.ParameterError, match=r"ends at 3\.4e38\. Write the coordinates in a larger"
        ):
            write()
    raw = np.frombuffer(write_raw(sequence, "float64"), "<f8")
    assert np.array_equal(raw, sequence.vertices.ravel())
