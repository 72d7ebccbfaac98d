"""A tolerance is met with the smallest whole set, or refused with the best; never exceeded."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from project import DATA
from tradeoff_cases import stated_error, true_errors, violations, violations_of

from modalmotion.errors import InputError, ModeCountError, ParameterError, ToleranceError
from modalmotion.formats import read_npz
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes import ModeSet, whole_count
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.signature.parameters import ErrorKind, ModeOrder
from modalmotion.simulate import Acquisition, VentricleParameters, simulate_ventricle
from modalmotion.store import signature_from_hdf5, signature_to_hdf5


@pytest.fixture(scope="module")
def beat() -> MeshSequence:
    parameters = VentricleParameters(motion_variation=2.0, shape_variation=2.0)
    acquisition = Acquisition(n_frames=10, noise=0.2)
    rng = np.random.default_rng(5)
    return simulate_ventricle(parameters, grid=(8, 16), acquisition=acquisition, rng=rng)


def errors_by_count(sequence: MeshSequence, kind: ErrorKind, **said: Any) -> dict[int, float]:
    """Error of every whole set up to 60 modes, each fitted by itself."""
    topology = sequence.topology
    assert topology is not None
    found = {}
    for n in range(1, 61):
        if whole_count(topology, n, sequence.grid) == n:
            signature = modal_signature(sequence, SignatureParameters(modes=n, **said))
            found[n] = stated_error(signature, kind)
    return found


@pytest.mark.every(3)
@pytest.mark.parametrize("kind", ErrorKind)
@pytest.mark.parametrize("said", [{}, {"harmonics": 3}, {"remove_rotation": False}])
def test_the_smallest_whole_set_that_holds_is_chosen(
    beat: MeshSequence, kind: ErrorKind, said: dict[str, Any]
) -> None:
    errors = errors_by_count(beat, kind, **said)
    rng = np.random.default_rng(1)
    limits = rng.uniform(min(errors.values()), max(errors.values()), 6)
    # The error of a set itself is held by that set.
    limits = np.append(limits, list(errors.values())[5])
    for limit in limits.tolist():
        asked = SignatureParameters(tolerance=limit, tolerance_of=kind, **said)
        smallest = min(n for n, error in errors.items() if error <= limit)
        assert len(modal_signature(beat, asked).modes) == smallest, limit


def test_the_largest_error_may_grow_with_the_set(beat: MeshSequence) -> None:
    # What makes the search for a largest error other than that for the RMS.
    errors = np.array(list(errors_by_count(beat, ErrorKind.MAX).values()))
    assert (np.diff(errors) > 0).any()


def test_stated_errors_are_true_and_tolerances_never_exceeded() -> None:
    rng = np.random.default_rng(11)
    for _ in range(25):
        assert violations(rng) == []


@pytest.mark.soak
def test_a_thousand_cases_without_a_violation() -> None:
    rng = np.random.default_rng(2024)
    for number in range(1000):
        assert violations(rng) == [], number


@pytest.mark.soak
def test_all_shared_sequences_without_a_violation() -> None:
    files = sorted(DATA.rglob("*.npz"))
    if not files:
        pytest.skip("../shared/data is absent")
    for path in files:
        sequence = read_npz(path.read_bytes()).sequence
        if sequence.unit is None:
            sequence = sequence.with_unit("mm")
        if sequence.topology is None and not len(sequence.faces):
            sequence = replace(sequence, topology=None).with_topology(modal_topology(path), None)
        motion = float(np.sqrt((modal_signature(sequence).motion_rms ** 2).mean()))
        mm = {"mm": 1.0, "m": 1e3, "cm": 10.0}.get(sequence.unit or "mm", 1.0)
        for asked in (
            SignatureParameters(tolerance=0.3 * motion * mm),
            SignatureParameters(tolerance_share=0.6, tolerance_of=ErrorKind.MAX, most_modes=60),
            SignatureParameters(auto=True, most_modes=100),
        ):
            assert violations_of(sequence, asked) == [], path.name


def modal_topology(path: Path) -> Any:
    from modalmotion.modes.topology import CLOSED_CURVE, OPEN_CURVE

    return OPEN_CURVE if path.parent.name == "tongue" else CLOSED_CURVE


def test_what_cannot_be_held_is_refused_with_the_best(beat: MeshSequence) -> None:
    asked = SignatureParameters(tolerance=0.05, most_modes=18)
    with pytest.raises(ToleranceError, match="18 modes") as caught:
        modal_signature(beat, asked)
    best = modal_signature(beat, SignatureParameters(modes=18)).rms_error
    assert caught.value.details["best_modes"] == 18
    assert caught.value.details["best_error"] == pytest.approx(best, rel=1e-9)
    assert caught.value.code == "tolerance_unreachable"


def test_the_best_largest_error_may_be_that_of_a_smaller_set(beat: MeshSequence) -> None:
    errors = errors_by_count(beat, ErrorKind.MAX)
    asked = SignatureParameters(tolerance=0.01, tolerance_of=ErrorKind.MAX, most_modes=25)
    with pytest.raises(ToleranceError) as caught:
        modal_signature(beat, asked)
    best = min((error, n) for n, error in errors.items() if n <= 25)
    assert caught.value.details["best_modes"] == best[1]
    assert caught.value.details["best_error"] == pytest.approx(best[0], rel=1e-9)


def test_all_modes_of_a_lattice_hold_nearly_nothing(beat: MeshSequence) -> None:
    signature = modal_signature(beat, SignatureParameters(tolerance=1e-9))
    assert len(signature.modes) == 128
    with pytest.raises(ToleranceError, match="vertices tell no more modes apart"):
        modal_signature(beat, SignatureParameters(tolerance=0.0))


def test_a_tolerance_is_in_mm_whatever_the_unit(beat: MeshSequence) -> None:
    in_mm = modal_signature(beat, SignatureParameters(tolerance=0.8))
    metres = mesh_sequence(
        beat.vertices / 1e3, beat.faces, grid=beat.grid, topology=beat.topology, unit="m"
    )
    in_m = modal_signature(metres, SignatureParameters(tolerance=0.8))
    assert len(in_m.modes) == len(in_mm.modes)
    assert in_m.rms_error <= 0.8e-3


def test_mm_without_a_unit_are_refused_with_the_remedy(beat: MeshSequence) -> None:
    bare = replace(beat, unit=None)
    with pytest.raises(ParameterError, match="State the unit"):
        modal_signature(bare, SignatureParameters(tolerance=1.0))
    share = modal_signature(bare, SignatureParameters(tolerance_share=0.2))
    motion = float(np.sqrt((share.motion_rms**2).mean()))
    assert share.rms_error <= 0.2 * motion
    assert share.choice is not None
    assert share.choice.limit == pytest.approx(0.2 * motion, rel=1e-12)


@pytest.mark.parametrize(
    "said",
    [
        {"modes": 7, "tolerance": 1.0},
        {"tolerance": 1.0, "auto": True},
        {"amplitudes": 21, "modes": 7},
        {"tolerance": 1.0, "tolerance_share": 0.1},
        {"tolerance": -1.0},
        {"tolerance": float("nan")},
        {"harmonics": -1},
    ],
)
def test_two_ways_at_once_and_impossible_numbers_are_refused(said: dict[str, Any]) -> None:
    with pytest.raises(ParameterError):
        SignatureParameters(**said)


def test_amplitudes_are_three_of_a_mode() -> None:
    assert SignatureParameters(amplitudes=21) == SignatureParameters(modes=7)
    assert SignatureParameters(amplitudes=20).modes == 7
    assert SignatureParameters() == SignatureParameters(modes=7)
    with pytest.raises(ModeCountError):
        SignatureParameters(amplitudes=0)


def test_names_of_requests_that_were_possible_before_are_unchanged() -> None:
    # Results that are kept are found by them.
    assert SignatureParameters().key == "60f2672a335f5957"
    assert SignatureParameters(tolerance=1.0).key != SignatureParameters(tolerance=2.0).key
    assert SignatureParameters(auto=True).key != SignatureParameters().key


def test_energy_order_takes_whole_pairs_that_move_most(beat: MeshSequence) -> None:
    asked = SignatureParameters(modes=7, order=ModeOrder.ENERGY, most_modes=40)
    signature = modal_signature(beat, asked)
    pool = modal_signature(beat, SignatureParameters(modes=40)).modes
    assert isinstance(signature.modes, ModeSet)
    assert isinstance(pool, ModeSet)
    labels = signature.modes.labels
    for wavenumbers, part in labels:
        if wavenumbers[1] != 0:
            assert (wavenumbers, {"cos": "sin", "sin": "cos"}[part]) in labels
    amplitudes = modal_signature(beat, SignatureParameters(modes=40)).amplitudes
    pairs = {label.wavenumbers: 0.0 for label in pool.labels}
    for label, energy in zip(pool.labels, (amplitudes**2).sum(axis=(0, 2)).tolist(), strict=True):
        pairs[label.wavenumbers] += energy
    kept = {label.wavenumbers for label in labels}
    least_kept = min(pairs[p] for p in kept - {(0, 0)})
    most_left = max(energy for p, energy in pairs.items() if p not in kept)
    assert least_kept >= most_left
    for name, true in true_errors(signature, beat).items():
        assert np.allclose(true, getattr(signature, name), atol=1e-11), name
    assert any("do not compare" in note for note in signature.notes)


def test_spring_modes_have_no_order_of_energy(beat: MeshSequence) -> None:
    with pytest.raises(InputError, match="rank"):
        modal_signature(
            beat, SignatureParameters(modes=3, order=ModeOrder.ENERGY, closed_form=False)
        )


def test_a_signature_by_tolerance_comes_back_from_its_file(beat: MeshSequence) -> None:
    for asked in (
        SignatureParameters(tolerance=0.8, tolerance_of=ErrorKind.MAX),
        SignatureParameters(auto=True),
        SignatureParameters(tolerance=1.0, order=ModeOrder.ENERGY),
        SignatureParameters(modes=7, harmonics=2),
    ):
        signature = modal_signature(beat, asked)
        image = signature_to_hdf5(signature)
        found = signature_from_hdf5(image)
        assert found.parameters == asked
        assert found.choice == signature.choice
        assert found.modes == signature.modes
        assert signature_to_hdf5(found) == image


def test_what_is_no_longer_compact_says_so_with_a_tolerance_that_is(beat: MeshSequence) -> None:
    signature = modal_signature(beat, SignatureParameters(tolerance=0.5))
    (note,) = [note for note in signature.notes if "no longer compact" in note]
    limit = float(re.findall(r"leave ([\d.e-]+) mm: ask for that tolerance", note)[0])
    compact = modal_signature(beat, SignatureParameters(tolerance=limit))
    assert 10 * len(compact.modes) <= beat.n_vertices < 10 * len(signature.modes)
    assert not any("compact" in note for note in compact.notes)
    stated = modal_signature(beat, SignatureParameters(modes=40))
    (note,) = [note for note in stated.notes if "no longer compact" in note]
    most = int(re.findall(r"Ask for at most (\d+) modes", note)[0])
    fewer = modal_signature(beat, SignatureParameters(modes=most))
    assert not any("compact" in note for note in fewer.notes) or len(fewer.modes) > most
    # The usual number is small on any surface that is worth a signature.
    assert not any("compact" in note for note in modal_signature(beat).notes)
