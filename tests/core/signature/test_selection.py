"""A tolerance is met with the smallest whole set, or refused with the best; never exceeded."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from project import DATA
from template_surfaces import make_ventricle
from tradeoff_cases import stated_error, violations, violations_of

from modalmotion.errors import ModeCountError, ParameterError, ToleranceError
from modalmotion.formats import read_npz
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes import whole_count
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.signature.parameters import ErrorKind
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
            SignatureParameters(tolerance=2 * motion * mm, tolerance_of=ErrorKind.MAX),
            SignatureParameters(auto=True),
        ):
            assert violations_of(sequence, asked) == [], path.name


def modal_topology(path: Path) -> Any:
    from modalmotion.modes.topologies import CLOSED_CURVE, OPEN_CURVE

    return OPEN_CURVE if path.parent.name == "tongue" else CLOSED_CURVE


@pytest.mark.parametrize("kind", ErrorKind)
def test_what_cannot_be_held_is_refused_with_the_best(kind: ErrorKind) -> None:
    vertices, faces = make_ventricle(40, np.random.default_rng(3))
    coarse = mesh_sequence(vertices, faces, unit="mm")
    with pytest.raises(ToleranceError) as caught:
        modal_signature(coarse, SignatureParameters(tolerance=1e-9, tolerance_of=kind))
    assert caught.value.code == "tolerance_unreachable"
    best, count = caught.value.details["best_error"], caught.value.details["best_modes"]
    assert isinstance(count, int)
    assert isinstance(best, float)
    alone = modal_signature(coarse, SignatureParameters(modes=count))
    assert best == pytest.approx(stated_error(alone, kind), rel=1e-9)
    others = [
        stated_error(modal_signature(coarse, SignatureParameters(modes=n)), kind)
        for n in range(1, count)
    ]
    assert best <= min(others) * (1 + 1e-9)
    named = float(re.findall(r"tolerance of (\S+) mm", caught.value.remedy or "")[0])
    held = modal_signature(coarse, SignatureParameters(tolerance=named, tolerance_of=kind))
    assert len(held.modes) == count


def test_all_modes_of_a_lattice_hold_nearly_nothing(beat: MeshSequence) -> None:
    signature = modal_signature(beat, SignatureParameters(tolerance=1e-9))
    assert len(signature.modes) == 128
    with pytest.raises(ToleranceError, match="vertices cannot distinguish more modes"):
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
    with pytest.raises(ParameterError) as caught:
        modal_signature(bare, SignatureParameters(tolerance=1.0))
    assert "Set the unit" in (caught.value.remedy or "")


@pytest.mark.parametrize(
    "said",
    [
        {"modes": 7, "tolerance": 1.0},
        {"tolerance": 1.0, "auto": True},
        {"amplitudes": 21, "modes": 7},
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


def test_requests_that_differ_have_different_names() -> None:
    # Results that are kept are found by them.
    assert SignatureParameters(tolerance=1.0).key != SignatureParameters(tolerance=2.0).key
    assert SignatureParameters(auto=True).key != SignatureParameters().key


def test_a_signature_by_tolerance_comes_back_from_its_file(beat: MeshSequence) -> None:
    for asked in (
        SignatureParameters(tolerance=0.8, tolerance_of=ErrorKind.MAX),
        SignatureParameters(auto=True),
        SignatureParameters(modes=7, harmonics=2),
    ):
        signature = modal_signature(beat, asked)
        image = signature_to_hdf5(signature)
        found = signature_from_hdf5(image)
        assert found.parameters == asked
        assert found.choice == signature.choice
        assert found.modes == signature.modes
        assert signature_to_hdf5(found) == image


def test_what_is_no_longer_compact_says_so(beat: MeshSequence) -> None:
    signature = modal_signature(beat, SignatureParameters(tolerance=0.5))
    assert any("no longer compact" in note for note in signature.notes)
    stated = modal_signature(beat, SignatureParameters(modes=40))
    (note,) = [note for note in stated.notes if "no longer compact" in note]
    most = int(re.findall(r"Ask for at most (\d+) modes", note.text)[0])
    fewer = modal_signature(beat, SignatureParameters(modes=most))
    assert not any("compact" in note for note in fewer.notes) or len(fewer.modes) > most
    # The usual number is small on any surface that is worth a signature.
    assert not any("compact" in note for note in modal_signature(beat).notes)
