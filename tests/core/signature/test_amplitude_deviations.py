"""Deviations of amplitudes against what drawn errors make of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from modalmotion.mesh.checks import Uncertainty
from modalmotion.mesh.sequence import MEAN, MeshSequence, Reference, mesh_sequence, standard_surface
from modalmotion.modes import lowest_modes
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CUP
from modalmotion.signature.making import SignatureKind, SignatureParameters, modal_signature
from modalmotion.template import make_template
from modalmotion.template.body_frame import Components
from modalmotion.template.template import shapes_of

Floats = NDArray[np.float64]

N_DRAWS = 150
CUP_SHAPE = standard_surface(Lattice(CUP, (8, 14)))
REST = CUP_SHAPE.vertices[0] * np.array([25.0, 22.0, 40.0])
# Turned, drifted and contracted: what the fit takes out is there.
TURN = np.array([[0.96, -0.28, 0.0], [0.28, 0.96, 0.0], [0.0, 0.0, 1.0]])
MOVED = (0.9 * REST) @ TURN.T + np.array([2.0, -1.0, 3.0])


def errors(rng: np.random.Generator) -> tuple[Floats, Uncertainty]:
    """Errors in modes, of a covariance that is not diagonal, and errors apart."""
    template = make_template(mesh_sequence(REST[None], CUP_SHAPE.faces))
    shapes = shapes_of(lowest_modes(template.topology, 7), template)
    m, n = shapes.shape[1], len(REST)
    root = 0.05 * rng.normal(size=(3 * m, 3 * m)) / np.sqrt(3 * m)
    C = root @ root.T
    c = (rng.normal(size=(N_DRAWS, 3 * m)) @ root.T).reshape(N_DRAWS, m, 3)
    apart = rng.normal(0.0, 0.1, (N_DRAWS, n, 3))
    return np.einsum("vm,fmi->fvi", shapes, c) + apart, Uncertainty(
        source="track",
        shapes=shapes,
        across=np.stack([np.zeros_like(C), *[C] * N_DRAWS]),
        along=np.stack([np.zeros_like(C), *[C] * N_DRAWS]),
        rest=np.array([0.0, *[0.1] * N_DRAWS]),
        alike=np.ones(n),
    )


@pytest.fixture(scope="module")
def drawn() -> MeshSequence:
    """A rest that is known, and after it one moved shape with another error in each frame."""
    e, uncertainty = errors(np.random.default_rng(0))
    sequence = mesh_sequence(np.concatenate([REST[None], MOVED + e]), CUP_SHAPE.faces)
    return replace(sequence, uncertainty=uncertainty)


@pytest.mark.every(3)
@pytest.mark.parametrize(
    "parameters",
    [
        SignatureParameters(modes=7),
        SignatureParameters(modes=4, remove_rotation=False),
        SignatureParameters(modes=4, components=Components.CYLINDRICAL),
        SignatureParameters(modes=7, kind=SignatureKind.NORMAL_DISPLACEMENT),
        SignatureParameters(modes=4, kind=SignatureKind.NORMAL_DISPLACEMENT, remove_rotation=False),
    ],
    ids=[
        "material",
        "with its rotation",
        "cylindrical",
        "normal displacement",
        "normal displacement with its rotation",
    ],
)
def test_deviations_are_those_of_drawn_errors(
    drawn: MeshSequence, parameters: SignatureParameters
) -> None:
    # All draws on one template.
    template = make_template(drawn)
    signature = modal_signature(drawn, replace(parameters, template=template.id), template=template)
    stated = signature.amplitude_deviations
    assert stated is not None
    assert not stated[0].any()
    found = signature.amplitudes[1:].std(axis=0)
    # The mean square over all frames: each is linearised at its own drawn shape.
    expected = np.sqrt((stated[1:] ** 2).mean(axis=0))
    # A deviation from n draws is known to 1 / sqrt(2 n), 6 %. Normal displacements are linear but
    # nearly: where a line meets the moved surface it is not at the vertex that it starts from.
    along_normal = parameters.kind == SignatureKind.NORMAL_DISPLACEMENT
    assert found == pytest.approx(expected, rel=0.35 if along_normal else 0.25)
    assert (found / expected).mean() == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("reference", [2, MEAN])
def test_errors_of_the_reference_count_and_those_in_common_do_not(reference: Reference) -> None:
    rng, n_frames, correlation = np.random.default_rng(1), 5, 0.8
    lags = np.abs(np.subtract.outer(np.arange(n_frames), np.arange(n_frames)))
    root = np.linalg.cholesky(correlation**lags)
    uncertainty = Uncertainty.of_noise(0.1, n_frames, len(REST), len(REST), correlation)
    amplitudes = []
    parameters = SignatureParameters(modes=2, reference=reference)
    for _ in range(15):
        e = 0.1 * np.tensordot(root, rng.normal(size=(n_frames, len(REST), 3)), axes=1)
        x = mesh_sequence(
            np.linspace(1.0, 0.9, n_frames)[:, None, None] * REST + e, CUP_SHAPE.faces
        )
        signature = modal_signature(replace(x, uncertainty=uncertainty), parameters)
        amplitudes.append(signature.amplitudes)
    assert signature.amplitude_deviations is not None
    found = np.sqrt(np.var(amplitudes, axis=0).mean(axis=(1, 2)))
    stated = np.sqrt((signature.amplitude_deviations**2).mean(axis=(1, 2)))
    assert stated == pytest.approx(found, rel=0.35, abs=1e-12)


def test_errors_in_common_do_not_average_out() -> None:
    x = mesh_sequence(np.stack([REST, MOVED]), CUP_SHAPE.faces)
    n = len(REST)
    template = make_template(x)
    single, alike = (
        modal_signature(
            replace(x, uncertainty=Uncertainty.of_noise(0.1, 2, n, independent)),
            SignatureParameters(template=template.id),
            template=template,
        )
        for independent in (n, n / 9)
    )
    assert single.amplitude_deviations is not None
    assert alike.amplitude_deviations == pytest.approx(3.0 * single.amplitude_deviations)
