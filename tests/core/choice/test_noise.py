"""The noise is estimated from the data, and modes stop where they would fit it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from modalmotion.choice.fitter import Fitter
from modalmotion.choice.noise_level import measure_noise
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import reconstruct
from modalmotion.simulate import Acquisition, VentricleParameters, simulate_ventricle
from modalmotion.template import make_template

SIZES: list[dict[str, Any]] = [{"grid": (16, 32)}, {"n_vertices": 600}]


def pair(
    size: dict[str, Any], noise: float, seed: int, n_frames: int = 20, variation: float = 2.0
) -> tuple[MeshSequence, MeshSequence]:
    """A ventricle with noise, and the same one without."""
    parameters = VentricleParameters(motion_variation=variation, shape_variation=variation)
    one, other = (
        simulate_ventricle(
            parameters,
            acquisition=Acquisition(n_frames=n_frames, noise=sigma),
            rng=np.random.default_rng(seed),
            **size,
        )
        for sigma in (noise, 0.0)
    )
    return one, other


def estimated(sequence: MeshSequence, **said: Any) -> float:
    asked = SignatureParameters(auto=True, **said)
    return measure_noise(Fitter.of(sequence, make_template(sequence), asked)).sigma


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("noise", [0.0, 0.1, 0.5, 1.0])
def test_the_noise_is_found_from_the_data(size: dict[str, Any], noise: float) -> None:
    sigma = estimated(pair(size, noise, seed=3)[0])
    if noise == 0.0:
        assert sigma <= 0.02
    else:
        assert sigma == pytest.approx(noise, rel=0.1)


@pytest.mark.parametrize("said", [{"reference": 7}, {"remove_rotation": False}])
def test_it_depends_on_no_reference(said: dict[str, Any]) -> None:
    assert estimated(pair(SIZES[0], 0.5, seed=4)[0], **said) == pytest.approx(0.5, rel=0.1)


def test_the_same_noise_in_metres() -> None:
    noisy = pair(SIZES[0], 0.5, seed=5)[0]
    metres = mesh_sequence(noisy.vertices / 1e3, grid=noisy.grid, topology="cup", unit="m")
    # Areas of a mesh weigh as those of the lattice drawn through the same nodes.
    assert estimated(metres) == pytest.approx(0.5e-3, rel=0.1)


def test_rounding_is_the_least_noise_there_is() -> None:
    noisy = pair(SIZES[0], 0.0, seed=6, variation=0.0)[0]
    rough = mesh_sequence(
        (noisy.vertices + 1e6).astype(np.float32), grid=noisy.grid, topology="cup", unit="mm"
    )
    step = float(np.spacing(np.float32(1e6)))
    assert estimated(rough) >= step / np.sqrt(12)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("noise", [0.2, 1.0])
def test_the_choice_is_near_the_best_count(size: dict[str, Any], noise: float) -> None:
    noisy, clean = pair(size, noise, seed=9)
    by_position, by_displacement = ratios(noisy, clean)
    assert by_position <= 1.1
    assert by_displacement <= 1.1


def ratios(noisy: MeshSequence, clean: MeshSequence) -> tuple[float, float]:
    """Error of the chosen count over that of the best one, against the truth.

    Of positions, on the reference as it was recorded; and of displacements, on the true one.
    """
    chosen = modal_signature(noisy, SignatureParameters(auto=True))
    counts = sorted({1, 4, 7, 13, 22, 37, 52, 76, 97, 121, len(chosen.modes)})
    errors = {n: distances(noisy, clean, n) for n in counts}
    found = errors[len(chosen.modes)]
    best = np.array(list(errors.values())).min(axis=0)
    return found[0] / best[0], found[1] / best[1]


def distances(noisy: MeshSequence, clean: MeshSequence, n_modes: int) -> tuple[float, float]:
    weights = make_template(noisy).weights
    offsets = reconstruct(modal_signature(noisy, SignatureParameters(modes=n_modes)), noisy)
    offsets = offsets - clean.vertices
    placed = float(np.sqrt((offsets**2).sum(axis=2) @ weights).mean())
    # The reference's own noise is common to all frames.
    moved = offsets - (noisy.vertices[0] - clean.vertices[0])
    return placed, float(np.sqrt(((moved**2).sum(axis=2) @ weights).mean()))


def test_one_frame_has_no_noise_to_find() -> None:
    noisy = pair(SIZES[0], 0.5, seed=2, n_frames=1)[0]
    signature = modal_signature(noisy, SignatureParameters(auto=True))
    assert len(signature.modes) == 1
    assert signature.choice is not None
    assert signature.choice.noise is not None
    assert signature.choice.noise.highest is None


def test_the_answer_says_what_was_estimated() -> None:
    noisy = pair(SIZES[0], 0.5, seed=2)[0]
    signature = modal_signature(noisy, SignatureParameters(auto=True))
    assert signature.choice is not None
    noise = signature.choice.noise
    assert noise is not None
    assert any(f"{noise.sigma:.3g} mm" in note for note in signature.notes)


@pytest.mark.soak
def test_noise_and_choice_on_many_ventricles() -> None:
    rng = np.random.default_rng(77)
    worst: dict[float, list[float]] = {}
    for _ in range(12):
        for noise in (0.0, 0.1, 0.5, 1.0):
            size = [*SIZES, {"grid": (32, 64)}, {"n_vertices": 1500}][rng.integers(4)]
            n_frames, variation = int(rng.choice([10, 25])), float(rng.choice([0.5, 2.0]))
            noisy, clean = pair(size, noise, int(rng.integers(1 << 30)), n_frames, variation)
            off = abs(estimated(noisy) - noise) / (noise or 1.0)
            assert off <= (0.2 if noise else 0.02)
            near = ratios(noisy, clean) if noise else (1.0, 1.0)
            assert max(near) <= 1.1
            row = worst.setdefault(noise, [0.0, 0.0, 0.0])
            worst[noise] = [max(a, b) for a, b in zip(row, [off, *near], strict=True)]
    for noise, (off, placed, moved) in worst.items():
        assert off <= 0.2, (noise, placed, moved)
