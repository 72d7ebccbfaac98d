"""The noise is estimated from the data, and modes stop where they would fit it."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mixed_noise import with_noise

from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.signature.choice import SceneKind
from modalmotion.signature.fit import Fitter
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.signature.nested_modes import nested_modes
from modalmotion.signature.noise import WIDE, Noise
from modalmotion.signature.noise import estimated as found_in
from modalmotion.signature.noise_bands import MIXINGS, SmoothNoise, bands_of, over_time
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
    return found_in(Fitter.of(sequence, make_template(sequence), asked)).noise.sigma


def test_what_noise_leaves_beyond_the_modes_of_a_lattice_is_no_less_than_rounding() -> None:
    angle = 2 * np.pi * np.arange(24) / 24
    tube, hole = np.meshgrid(angle, angle, indexing="ij")
    x, y, z = (3 + np.cos(tube)) * np.cos(hole), (3 + np.cos(tube)) * np.sin(hole), np.sin(tube)
    start = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    frames = np.stack([start * [1 + k / 40, 1, 1] for k in range(8)])
    torus = mesh_sequence(frames, topology="torus", grid=(24, 24))
    fitter = Fitter.of(torus, make_template(torus), SignatureParameters())
    ladder = nested_modes(fitter.template, 128, torus.grid)
    smooth = SmoothNoise.on(fitter.template)
    bands = bands_of(fitter, ladder, fitter.along(ladder.basis.analysis), smooth)
    largest = bands.expected.max(axis=1, keepdims=True)
    assert (bands.expected > 4 * np.finfo(np.float64).eps * largest).all()


@pytest.mark.every(3)
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


@pytest.mark.every(2)
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("noise", [0.2, pytest.param(1.0, marks=pytest.mark.soak)])
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


# Mixed with the neighbours so often, and the correlation of a frame with the next.
KINDS = [(0, 0.0), (1, 0.0), (5, 0.0), (20, 0.0), (0, 0.9)]
SURFACES: list[dict[str, Any]] = [{"grid": (20, 40)}, {"n_vertices": 700}]


def measured(sequence: MeshSequence) -> Noise:
    asked = SignatureParameters(auto=True)
    return found_in(Fitter.of(sequence, make_template(sequence), asked)).noise


def is_right(noise: Noise, sigma: float) -> bool:
    """Within 15 %, or in a range whose ends differ by at most a half."""
    assert noise.highest is not None
    near = abs(noise.sigma - sigma) <= 0.15 * sigma
    return near or (noise.lowest <= sigma <= noise.highest <= WIDE * noise.lowest)


@pytest.mark.every(2)
@pytest.mark.parametrize(("mixed", "correlation"), KINDS)
@pytest.mark.parametrize(
    "size", [SURFACES[0], *(pytest.param(one, marks=pytest.mark.soak) for one in SURFACES[1:])]
)
def test_level_and_correlation_are_found_together(
    size: dict[str, Any], mixed: int, correlation: float
) -> None:
    clean = pair(size, 0.0, seed=31, n_frames=25)[1]
    noise = measured(with_noise(clean, 0.6, np.random.default_rng(32), mixed, correlation))
    assert is_right(noise, 0.6)
    assert noise.between_frames == pytest.approx(correlation, abs=0.12)
    beside = {0: 0.0, 1: 0.58, 5: 0.9, 20: 0.98}[mixed]
    assert noise.between_neighbours == pytest.approx(beside, abs=0.08)


@pytest.mark.parametrize(
    ("mixed", "correlation"),
    [one if one == (5, 0.0) else pytest.param(*one, marks=pytest.mark.soak) for one in KINDS],
)
def test_smooth_noise_is_not_modelled(mixed: int, correlation: float) -> None:
    rng = np.random.default_rng(5)
    n_kept = n_best = 0
    excesses = []
    for seed in (41, 42):
        clean = pair({"grid": (20, 40)}, 0.0, seed, n_frames=25)[1]
        noisy = with_noise(clean, 0.6, rng, mixed, correlation)
        kept, best, excess = kept_and_best(noisy, clean)
        n_kept, n_best = n_kept + kept, n_best + best
        excesses.append(excess)
    assert n_kept <= 1.3 * n_best
    assert np.mean(excesses) <= 1.1


def kept_and_best(noisy: MeshSequence, clean: MeshSequence) -> tuple[int, int, float]:
    """Modes that `auto` keeps, those that are best for the displacements, and its excess error."""
    kept = len(modal_signature(noisy, SignatureParameters(auto=True)).modes)
    fitter = Fitter.of(noisy, make_template(noisy), SignatureParameters(auto=True))
    ladder = nested_modes(fitter.template, max(200, kept), noisy.grid)
    fit = fitter.fit(ladder.basis)
    true = Fitter.of(clean, fitter.template).fit(ladder.basis).amplitudes
    R = ladder.basis.triangle
    brought = (np.einsum("ij,tjd->tid", R, fit.amplitudes - true) ** 2).sum(axis=(0, 2))
    lost = (np.einsum("ij,tjd->tid", R, true) ** 2).sum(axis=(0, 2))
    counts = ladder.counts
    # What all these modes leave is lost with any of them.
    risk = np.append(np.cumsum(lost[::-1])[::-1], 0.0)[counts]
    risk += np.concatenate([[0.0], np.cumsum(brought)])[counts]
    best = int(np.argmin(risk))
    own = int(np.searchsorted(counts, kept))
    return kept, int(counts[best]), float(np.sqrt(risk[own] / risk[best]))


def test_what_cannot_be_told_apart_has_a_wide_range() -> None:
    # Two frames: any smooth field may be motion or noise.
    noisy = with_noise(pair(SIZES[0], 0.0, 3, n_frames=2)[1], 0.6, np.random.default_rng(1), 20)
    noise = measured(noisy)
    assert noise.highest is not None
    assert noise.lowest <= 0.6 <= noise.highest
    assert noise.highest > WIDE * noise.lowest
    assert "hard to distinguish" in noise.note("mm")


def test_a_shift_of_all_vertices_counts_as_motion() -> None:
    clean = pair(SIZES[0], 0.0, 3)[1]
    shifts = np.random.default_rng(2).normal(0.0, 0.6, (clean.n_frames, 1, 3))
    assert measured(replace(clean, vertices=clean.vertices + shifts)).sigma <= 0.03


@pytest.mark.parametrize("mixed", [0, 20])
def test_noise_without_motion_is_a_static_scene(mixed: int) -> None:
    clean = pair(SIZES[0], 0.0, 3)[1]
    still = replace(
        clean, vertices=np.repeat(clean.vertices[:1].astype(np.float64), clean.n_frames, axis=0)
    )
    assert measured(still).sigma == measured(still).rounding
    noisy = with_noise(still, 0.6, np.random.default_rng(4), mixed)
    choice = modal_signature(noisy, SignatureParameters(auto=True)).choice
    assert choice is not None
    assert choice.scene == SceneKind.STATIC


@pytest.mark.every(2)
@pytest.mark.parametrize("scale", [1e-300, 1e-150, 1e150, 1e300])
def test_scale_changes_nothing(scale: float) -> None:
    clean = pair({"grid": (8, 16)}, 0.0, 7)[1]
    noisy = with_noise(clean, 0.6, np.random.default_rng(8), mixed=2)
    noisy = replace(noisy, unit=None)
    one, other = measured(noisy), measured(replace(noisy, vertices=noisy.vertices * scale))
    assert other.sigma / scale == pytest.approx(one.sigma, rel=1e-6)
    assert other.mixed == one.mixed


@pytest.mark.parametrize("reference", [0, 3, "mean"])
def test_displacements_by_noise_alone(reference: int | str, rng: np.random.Generator) -> None:
    noise = Noise(0.5, 0.5, 0.5, 0.7, 0.0, 100.0, 0, 0.0, 7)
    root = np.linalg.cholesky(over_time(0.7, 9))
    paths = 0.5 * np.einsum("fg,gn->fn", root, rng.standard_normal((9, 300_000)))
    start = paths.mean(axis=0) if reference == "mean" else paths[int(reference)]
    rms = float(np.sqrt(3.0 * ((paths - start) ** 2).mean()))
    assert noise.displacement_rms(9, reference) == pytest.approx(rms, rel=0.01)  # type: ignore[arg-type]


def test_bands_expect_what_noise_brings(rng: np.random.Generator) -> None:
    clean = pair(SIZES[0], 0.0, 3)[1]
    still = replace(
        clean, vertices=np.repeat(clean.vertices[:1].astype(np.float64), 100, axis=0), times=None
    )
    for part, mixed in enumerate(MIXINGS[:5]):
        noisy = with_noise(still, 0.6, rng, mixed)
        # The true reference, so that no frame's noise is in all displacements.
        start = replace(noisy, vertices=np.concatenate([still.vertices[:1], noisy.vertices]))
        asked = SignatureParameters(remove_rotation=False)
        fitter = Fitter.of(start, make_template(start), asked)
        smooth = SmoothNoise.on(fitter.template)
        ladder = nested_modes(fitter.template, 128, start.grid)
        bands = bands_of(fitter, ladder, fitter.along(ladder.basis.analysis), smooth)
        energies = np.trace(bands.grams.sum(axis=0), axis1=1, axis2=2) * bands.scale**2 / 300.0
        assert energies == pytest.approx(0.36 * bands.expected[part], rel=0.2)


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


@pytest.mark.soak
@pytest.mark.parametrize(("mixed", "correlation"), [*KINDS, (5, 0.9), (20, 0.5)])
def test_noise_of_any_kind_on_many_ventricles(mixed: int, correlation: float) -> None:
    rng = np.random.default_rng(100 * mixed + 7)
    n = 100 * int(os.environ.get("SOAK", "1"))
    n_right = 0
    sizes = [*SIZES, {"grid": (32, 64)}, {"n_vertices": 1500}]
    for k in range(n):
        n_frames, sigma = int(rng.choice([20, 25, 30])), float(rng.choice([0.3, 0.6, 1.0]))
        clean = pair(sizes[k % 4], 0.0, int(rng.integers(1 << 30)), n_frames)[1]
        n_right += is_right(measured(with_noise(clean, sigma, rng, mixed, correlation)), sigma)
    assert n_right >= (0.95 if (mixed, correlation) in KINDS else 0.8) * n
