"""The front from one factorisation is that of every set fitted by itself."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tradeoff_cases import true_errors

from modalmotion.errors import ParameterError, ToleranceError
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.pictures.signature import tradeoff_figure
from modalmotion.signature import measure_tradeoff, price_of
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.signature.nested_modes import harmonics_of, n_functions, nested_modes
from modalmotion.signature.tradeoff import as_plain
from modalmotion.simulate import Acquisition, VentricleParameters, simulate_ventricle
from modalmotion.template import make_template
from modalmotion.template.body_frame import Components


def ventricle(**size: Any) -> MeshSequence:
    return simulate_ventricle(
        VentricleParameters(motion_variation=2.0, shape_variation=2.0),
        acquisition=Acquisition(n_frames=9, noise=0.1),
        rng=np.random.default_rng(8),
        **size,
    )


@pytest.fixture(scope="module")
def beat() -> MeshSequence:
    return ventricle(grid=(8, 16))


@pytest.mark.every(2)
@pytest.mark.parametrize("size", [{"grid": (8, 16)}, {"n_vertices": 150}])
def test_every_point_is_the_error_of_its_own_fit(size: dict[str, Any]) -> None:
    sequence = ventricle(**size)
    asked = SignatureParameters()
    front = measure_tradeoff(sequence, asked, most_modes=25).front
    assert front.branches[0].components == Components.CARTESIAN
    for branch in front.branches:
        for k in range(0, len(branch.counts), 5):
            for harmonics in (None, 0, 2):
                own = replace(
                    asked,
                    topology=branch.topology,
                    modes=int(branch.counts[k]),
                    components=branch.components,
                    harmonics=harmonics,
                )
                alone = modal_signature(sequence, own).rms_error
                told = branch.rms[k] if harmonics is None else branch.joint_rms[k, harmonics]
                assert told == pytest.approx(alone, rel=1e-10)


def test_cup_and_cylinder_are_measured_side_by_side(beat: MeshSequence) -> None:
    names = [(b.topology, b.components.value) for b in measure_tradeoff(beat).front.branches]
    assert names == [
        ("cup", "cartesian"),
        ("cup", "cylindrical"),
        ("cylinder", "cartesian"),
        ("cylinder", "cylindrical"),
    ]
    only = measure_tradeoff(beat, SignatureParameters(topology="cylinder")).front.branches
    assert {b.topology for b in only} == {"cylinder"}


def test_small_errors_do_not_come_from_differences_of_large_ones() -> None:
    beat = ventricle(grid=(4, 6))
    # Far away and moving far, with a residual of 1e-13 of the motion.
    moved = mesh_sequence(
        beat.vertices + 1e3 * np.arange(9)[:, None, None], grid=(4, 6), topology="cup", unit="mm"
    )
    front = measure_tradeoff(moved, most_modes=24).front
    rms = front.branches[0].rms
    assert (np.diff(rms) <= 0).all()
    assert rms[-1] < 1e-9
    near = modal_signature(moved, SignatureParameters(modes=22)).rms_error
    assert rms[list(front.branches[0].counts).index(22)] == pytest.approx(near, rel=1e-6)


def test_a_ladder_ends_where_vertices_or_condition_end_it() -> None:
    beat = ventricle(n_vertices=60)
    ladder = nested_modes(make_template(beat), 2000, None)
    assert ladder.ends_because
    assert ladder.basis.condition <= 1e8
    assert modal_signature(beat, SignatureParameters(modes=int(ladder.counts[-1]))).condition <= 1e8


def test_harmonics_are_least_squares_on_the_times_as_they_are() -> None:
    rng = np.random.default_rng(2)
    times = np.sort(rng.uniform(0.0, 1.0, 20))
    x = (times - times[0]) / ((times[-1] - times[0]) * 20 / 19)
    design = np.stack(
        [np.ones(20), x, *(g(2 * np.pi * p * x) for p in (1, 2) for g in (np.cos, np.sin))], axis=1
    )
    paths = rng.normal(size=(20, 4, 3))
    flat = paths.reshape(20, -1)
    naive = design @ np.linalg.lstsq(design, flat, rcond=None)[0]
    found = harmonics_of(20, times).limited(paths, 2)
    assert np.allclose(found.reshape(20, -1), naive, atol=1e-12)
    assert n_functions(2) == design.shape[1]


def test_a_movement_that_does_not_come_back_is_not_closed_by_force() -> None:
    line = np.linspace(0.0, 5.0, 12)[:, None, None] * np.ones((1, 2, 3))
    assert np.allclose(harmonics_of(12, None).limited(line, 0), line, atol=1e-13)


@pytest.mark.parametrize("n_frames", [1, 2, 3, 4, 5])
def test_short_sequences_have_the_harmonics_they_have(n_frames: int) -> None:
    found = harmonics_of(n_frames, None)
    assert found.functions.shape[0] == n_frames
    assert np.allclose(found.functions.T @ found.functions, np.eye(found.functions.shape[1]))
    assert found.most == max(n_frames - 2, 0) // 2


def test_more_harmonics_than_frames_tell_apart_are_refused(beat: MeshSequence) -> None:
    with pytest.raises(ParameterError, match="cannot be distinguished"):
        modal_signature(beat, SignatureParameters(harmonics=4))
    with pytest.raises(ParameterError, match="cannot be distinguished"):
        measure_tradeoff(beat, SignatureParameters(tolerance=1.0, harmonics=4))


def test_the_price_is_the_error_of_the_surface_itself(beat: MeshSequence) -> None:
    chosen = measure_tradeoff(beat, SignatureParameters(tolerance=0.8)).chosen
    own = modal_signature(beat, SignatureParameters(tolerance=0.8))
    assert (own.amplitudes == chosen.signature.amplitudes).all()
    assert chosen.price.rms_error <= 0.8
    true = true_errors(chosen.signature, beat)
    for name in ("rms_error", "weighted_rms_error"):
        rms = float(np.sqrt((true[f"{name}s"] ** 2).mean()))
        assert getattr(chosen.price, name) == pytest.approx(rms, rel=1e-11), name
    assert chosen.price.p95_error == pytest.approx(float(true["p95_errors"].max()), rel=1e-11)
    assert chosen.price.max_error == pytest.approx(float(true["max_errors"].max()), rel=1e-11)


def test_beyond_the_front_a_tolerance_reaches_further(beat: MeshSequence) -> None:
    asked = SignatureParameters(tolerance=0.3)
    found = measure_tradeoff(beat, asked, most_modes=7)
    assert found.chosen.price.rms_error <= 0.3
    with pytest.raises(ToleranceError):
        measure_tradeoff(beat, SignatureParameters(tolerance=0.0), most_modes=7)


def test_a_price_counts_what_is_kept(beat: MeshSequence) -> None:
    price = price_of(modal_signature(beat, SignatureParameters(modes=7)), {"fit": 1.5})
    assert (price.amplitudes_per_frame, price.numbers) == (21, 21 * 9)
    assert (price.bytes, price.bytes_float32) == (8 * 21 * 9, 4 * 21 * 9)
    assert price.compression == pytest.approx(3 * 128 / 21)
    assert price.compression_of_sequence == pytest.approx(9 * 384 / (9 * 21 + 384))
    assert price.milliseconds == {"fit": 1.5}
    limited = price_of(modal_signature(beat, SignatureParameters(modes=7, harmonics=1)))
    assert limited.numbers == 21 * 4


def test_prices_are_in_mm(beat: MeshSequence) -> None:
    metres = mesh_sequence(
        beat.vertices / 1e3, beat.faces, grid=beat.grid, topology="cup", unit="m"
    )
    one, other = (price_of(modal_signature(s)) for s in (beat, metres))
    assert other.rms_error == pytest.approx(one.rms_error, rel=1e-9)
    assert other.unit == "mm"
    assert price_of(modal_signature(replace(beat, unit=None))).unit is None


def test_the_picture_shows_every_branch_and_the_chosen_point(beat: MeshSequence) -> None:
    found = measure_tradeoff(beat, SignatureParameters(tolerance=0.8), most_modes=25)
    figure = tradeoff_figure(found)
    labels = figure.axes[0].get_legend_handles_labels()[1]
    assert labels[:4] == [f"{b.topology}, {b.components}" for b in found.front.branches]
    assert labels[-1].startswith("chosen")
    assert len(figure.axes) >= 3
    plain = as_plain(found)
    assert plain["chosen"]["price"]["rms_error"] == found.chosen.price.rms_error


def test_a_static_scene_can_be_drawn() -> None:
    still = mesh_sequence(
        np.repeat(ventricle(grid=(4, 6)).vertices[:1], 3, axis=0),
        grid=(4, 6),
        topology="cup",
        unit="mm",
    )
    found = measure_tradeoff(still, SignatureParameters(tolerance=0.1))
    tradeoff_figure(found).savefig("/dev/null", format="png")
    assert found.chosen.kind == "static"
