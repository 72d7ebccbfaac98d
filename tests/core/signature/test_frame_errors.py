"""Stated errors against those of the reconstructed vertices, by their names: docs/error.md."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from modalmotion.errors import ToleranceError
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.signature import measure_tradeoff
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.signature.parameters import ErrorKind
from modalmotion.signature.reconstruction import reconstruct
from modalmotion.simulate import Acquisition, VentricleParameters, simulate_ventricle
from modalmotion.template import make_template
from modalmotion.template.body_frame import Components

Floats = NDArray[np.float64]


def with_loose(sequence: MeshSequence, n: int, far: float, seed: int = 0) -> MeshSequence:
    """The same surface and vertices in no triangle, half of them before the others."""
    rng = np.random.default_rng(seed)
    x = np.asarray(sequence.vertices, dtype=np.float64)
    extent = float(np.ptp(x[0], axis=0).max())
    places = x[0].mean(axis=0) + far * extent * rng.normal(size=(n, 3))
    loose = places + 0.05 * extent * rng.normal(size=(len(x), n, 3))
    half = n // 2
    return mesh_sequence(
        np.concatenate([loose[:, :half], x, loose[:, half:]], axis=1),
        sequence.faces + half,
        times=sequence.times,
        unit=sequence.unit,
    )


@pytest.fixture(scope="module")
def beat() -> MeshSequence:
    # Triangles of many sizes: where vertices are dense the two RMS errors differ.
    rng = np.random.default_rng(4)
    even = simulate_ventricle(
        VentricleParameters(),
        n_vertices=300,
        acquisition=Acquisition(n_frames=8, noise=0.3),
        rng=rng,
    )
    return with_loose(mesh_sequence(even.vertices, even.faces, unit="mm"), 5, 1.0)


def errors_of(signature: ModalSignature, sequence: MeshSequence) -> dict[str, Floats]:
    """Every error of each frame, from the reconstructed vertices."""
    asked = signature.parameters
    template = make_template(sequence, reference=asked.reference)
    weights = np.delete(template.weights, template.isolated)
    d = np.linalg.norm(reconstruct(signature, sequence) - sequence.vertices, axis=2)
    # Vertices in no triangle count in no error.
    d = np.delete(d, template.isolated, axis=1)
    return {
        "rms_errors": np.sqrt((d**2).mean(axis=1)),
        "weighted_rms_errors": np.sqrt((d**2) @ weights),
        "p95_errors": np.array([np.sort(row)[::-1][len(row) // 20] for row in d]),
        "max_errors": d.max(axis=1),
    }


def assert_true(signature: ModalSignature, sequence: MeshSequence) -> None:
    size = float(np.abs(sequence.vertices[0]).max())
    true = errors_of(signature, sequence)
    for name, values in true.items():
        stated = getattr(signature, name)
        np.testing.assert_allclose(stated, values, rtol=1e-9, atol=1e-9 * size, err_msg=name)
    for name in ("rms_error", "weighted_rms_error"):
        over_all = np.sqrt((true[f"{name}s"] ** 2).mean())
        assert getattr(signature, name) == pytest.approx(over_all, rel=1e-9), name
    assert signature.max_error == pytest.approx(true["max_errors"].max(), rel=1e-9)


@pytest.mark.every(2)
@pytest.mark.parametrize("components", Components)
@pytest.mark.parametrize("harmonics", [None, 1])
@pytest.mark.parametrize("modes", [1, 7, 18, 54])
def test_stated_errors_are_those_of_the_reconstructed_vertices(
    beat: MeshSequence, components: Components, harmonics: int | None, modes: int
) -> None:
    asked = SignatureParameters(modes=modes, components=components, harmonics=harmonics)
    assert_true(modal_signature(beat, asked), beat)


def test_spring_modes_and_kept_rotations_too(beat: MeshSequence) -> None:
    for asked in (
        SignatureParameters(modes=12, topology="mesh"),
        SignatureParameters(reference=3),
        SignatureParameters(remove_rotation=False),
    ):
        signature = modal_signature(beat, asked)
        assert_true(signature, beat)


def test_on_a_real_ventricle_with_loose_vertices(
    real_sequence: Callable[[str], MeshSequence],
) -> None:
    sequence = with_loose(real_sequence("heart/lv_endocardium"), 4, 2.0)
    for modes in (1, 7, 18, 54):
        signature = modal_signature(sequence, SignatureParameters(modes=modes))
        assert_true(signature, sequence)


@pytest.mark.soak
def test_on_all_shared_sequences_with_loose_vertices(
    real_data: Path, real_sequence: Callable[[str], MeshSequence]
) -> None:
    for path in sorted(real_data.rglob("*.npz")):
        sequence = real_sequence(str(path.relative_to(real_data).with_suffix("")))
        if not len(sequence.faces):
            continue
        # Long recordings in part: what grows with them is time.
        step = -(-sequence.vertices.size // 3_000_000)
        sequence = mesh_sequence(
            np.asarray(sequence.vertices[::step]), sequence.faces, unit=sequence.unit
        )
        sequence = with_loose(sequence, 4, 2.0)
        for modes in (1, 7, 18, 54):
            assert_true(modal_signature(sequence, SignatureParameters(modes=modes)), sequence)


@pytest.mark.every(3)
@pytest.mark.parametrize("kind", ErrorKind)
def test_a_tolerance_holds_for_what_was_sent(beat: MeshSequence, kind: ErrorKind) -> None:
    name = {"rms": "rms_error", "weighted_rms": "weighted_rms_error", "max": "max_error"}[kind]
    with pytest.raises(ToleranceError) as refused:
        modal_signature(beat, SignatureParameters(tolerance=0.01, tolerance_of=kind))
    least = refused.value.details["best_error_mm"]
    assert isinstance(least, float)
    n_held = 0
    for limit in np.geomspace(least * 1.001, 8.0 * least, 5).tolist():
        asked = SignatureParameters(tolerance=limit, tolerance_of=kind)
        signature = modal_signature(beat, asked)
        assert_true(signature, beat)
        assert getattr(signature, name) <= limit
        traded = measure_tradeoff(beat, asked).chosen
        assert getattr(traded.price, name) <= limit
        n_held += len(signature.modes) > 1
    assert n_held > 0 or kind == ErrorKind.MAX


def test_a_loose_vertex_counts_in_no_error_and_moves_as_its_nearest(beat: MeshSequence) -> None:
    x: Floats = np.asarray(beat.vertices, dtype=np.float64)
    near = int(beat.faces[7, 0])
    follower = x[:, [near]] + 0.1
    both = mesh_sequence(np.concatenate([x, follower], axis=1), beat.faces, unit="mm")
    for asked in (SignatureParameters(), SignatureParameters(topology="mesh", modes=9)):
        signature = modal_signature(both, asked)
        moved = reconstruct(signature, both) - both.vertices[0]
        # But for the rotation, which turns places that differ.
        unturned = np.einsum("fji,fnj->fni", signature.rotations.matrices, moved)
        gap = np.abs(unturned[:, -1] - unturned[:, near]).max()
        assert gap < 0.1
    stray = follower.copy()
    stray[4] += 50.0
    sent = mesh_sequence(np.concatenate([x, stray], axis=1), beat.faces, unit="mm")
    signature = modal_signature(sent)
    assert signature.max_error == pytest.approx(modal_signature(both).max_error, rel=1e-9)
    assert any("belong to no triangle" in note for note in signature.notes)
