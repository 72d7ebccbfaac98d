"""What the shipped model says of ventricles it has not seen, and when it says nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from modalmotion.classification import (
    DEFAULT_MODEL,
    OFFSET_MODEL,
    Classification,
    classify,
    load_model,
    shipped_for,
)
from modalmotion.classification.training.train_shipped import OFFSET, surfaces_of
from modalmotion.facts import Facts
from modalmotion.facts.facts import Tracking
from modalmotion.mesh import lattice_faces
from modalmotion.mesh.sequence import MEAN, MeshSequence, mesh_sequence
from modalmotion.modes import lowest_modes
from modalmotion.modes.topology import CUP, CYLINDER, PLANE
from modalmotion.signature.making import SignatureKind, SignatureParameters, modal_signature
from modalmotion.simulate import (
    Acquisition,
    Case,
    MotionClass,
    VentricleParameters,
    simulate_ventricle,
)
from modalmotion.template import Weights
from modalmotion.template.body_frame import Components

CLEAR = {
    MotionClass.NORMAL: {},
    MotionClass.HYPOKINESIA: {
        "ejection_fraction": 0.28,
        "longitudinal_shortening": 0.09,
        "apex_rotation": 4.5,
        "base_rotation": -2.0,
        "radius": 29.0,
    },
    MotionClass.AKINESIA: {"ejection_fraction": 0.42, "akinesia": 1.0},
    MotionClass.DYSSYNCHRONY: {
        "ejection_fraction": 0.35,
        "longitudinal_shortening": 0.11,
        "delay": 0.12,
        "septal_flash": 0.25,
        "apex_rotation": 5.0,
    },
    MotionClass.REDUCED_TORSION: {"apex_rotation": 1.0, "base_rotation": 1.0},
}
PARAMETERS = load_model().signature_parameters
CHANGES = [
    "moved",
    "start angle",
    "other way round",
    "frame rate",
    "float32",
    "metres",
    "start phase",
    "closed",
]


@cache
def ventricle(label: MotionClass, n_vertices: int | None = None, **options: float) -> MeshSequence:
    acquisition = replace(Acquisition(n_frames=24), **options)  # type: ignore[arg-type]
    parameters = VentricleParameters(shape_variation=1.0, motion_variation=1.0)
    return simulate_ventricle(
        replace(parameters, **CLEAR[label]),
        grid=(16, 40),
        n_vertices=n_vertices,
        acquisition=acquisition,
        rng=np.random.default_rng(21),
    )


def answer(sequence: MeshSequence, tracking: Tracking = "material") -> Classification:
    return classify(sequence.with_facts(Facts(tracking=tracking, handedness="right")))


@cache
def plain_answer(label: MotionClass) -> Classification:
    return answer(ventricle(label))


def with_vertices(sequence: MeshSequence, vertices: np.ndarray, **changes: str) -> MeshSequence:
    return mesh_sequence(
        vertices,
        sequence.faces,
        grid=sequence.grid,
        topology=sequence.topology,
        times=sequence.times,
        unit=changes.get("unit", sequence.unit),
    )


def changed(label: MotionClass, change: str) -> MeshSequence:
    sequence = ventricle(label)
    x = sequence.vertices
    grid = x.reshape(len(x), 16, 40, 3)
    match change:
        case "moved":
            turn = Rotation.from_rotvec([1.0, 2.0, -0.5]).as_matrix()
            return with_vertices(sequence, x @ turn.T + [50.0, -20.0, 300.0])
        case "start angle":
            return with_vertices(sequence, np.roll(grid, 13, axis=2).reshape(x.shape))
        case "other way round":
            return replace(
                with_vertices(sequence, grid[:, :, ::-1].reshape(x.shape)),
                faces=np.zeros((0, 3), dtype=np.int64),
            )
        case "frame rate":
            return ventricle(label, n_frames=48)
        case "float32":
            return with_vertices(sequence, x.astype(np.float32))
        case "metres":
            return with_vertices(sequence, x / 1000.0, unit="m")
        case "start phase":
            return ventricle(label, start_phase=0.9)
        case "closed":
            return ventricle(label, n_frames=25, is_closed=True)
    raise AssertionError(change)


@pytest.mark.parametrize("label", MotionClass)
def test_clear_cases_are_named_on_lattices_and_triangulations(label: MotionClass) -> None:
    for n_vertices in (None, 900):
        found = answer(ventricle(label, n_vertices, noise=0.6))
        assert found.label == label
        assert found.probability > 0.6
        assert found.probabilities.sum() == pytest.approx(1.0)
        assert any("no patient" in note for note in found.notes)


@pytest.mark.every(7)
@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("label", MotionClass)
def test_the_answer_does_not_depend_on_how_it_was_recorded(label: MotionClass, change: str) -> None:
    plain, other = plain_answer(label), answer(changed(label, change))
    assert plain.label == other.label == label
    assert np.abs(plain.probabilities - other.probabilities).max() <= 0.01
    is_mirrored = any("left-handed" in note for note in other.notes)
    assert is_mirrored == (change == "other way round")


def test_reduced_torsion_comes_with_a_warning() -> None:
    found = answer(ventricle(MotionClass.REDUCED_TORSION))
    assert "contours" in found.notes[0]


def assert_abstains(found: Classification, why: str) -> None:
    assert found.label is None
    assert found.flags
    assert found.class_set == found.classes
    assert why in found.notes[0]
    assert found.probabilities == pytest.approx(np.full(5, 0.2))
    assert any("no patient" in note for note in found.notes)


def test_it_abstains_where_nothing_moves(rng: np.random.Generator) -> None:
    sequence = ventricle(MotionClass.NORMAL)
    first = sequence.vertices[:1]
    still = with_vertices(sequence, np.repeat(first, 24, axis=0))
    assert_abstains(answer(still), "no motion")
    shaking = still.vertices + rng.normal(0.0, 0.6, still.vertices.shape)
    assert_abstains(answer(with_vertices(sequence, shaking)), "no motion")
    turns = Rotation.from_rotvec(np.outer(np.linspace(0.0, 1.0, 24), [0.3, 1.0, 0.2]))
    turning = np.einsum("fij,nj->fni", turns.as_matrix(), first[0])
    assert_abstains(answer(with_vertices(sequence, turning)), "no motion")


def test_it_abstains_on_noise_and_on_the_unknown(rng: np.random.Generator) -> None:
    sequence = ventricle(MotionClass.NORMAL)
    signature = modal_signature(sequence, PARAMETERS)
    shape = signature.amplitudes.shape
    noise = replace(signature, amplitudes=rng.normal(0.0, 3.0, shape))
    assert_abstains(classify(noise, load_model()), "noise")
    # As smooth as a beat, as large as a beat, and no beat.
    phase = 2 * np.pi * np.arange(24) / 24
    wobble = np.cos(phase[:, None, None] + rng.uniform(0.0, 6.0, shape[1:])) * 3.0
    assert_abstains(classify(replace(signature, amplitudes=wobble), load_model()), "No class")


def test_it_abstains_on_what_it_cannot_read() -> None:
    sequence = ventricle(MotionClass.NORMAL)
    single = mesh_sequence(sequence.vertices[:1], grid=(16, 40), topology="cup", unit="mm")
    assert_abstains(answer(single), "one frame")
    assert_abstains(answer(replace(sequence, topology=PLANE)), "plane")
    for changes, why in (
        ({"modes": 18}, "18"),
        ({"weights": Weights.UNIFORM}, "area weights"),
        ({"remove_rotation": False}, "rotation removed"),
        ({"components": Components.CYLINDRICAL}, "cartesian"),
        ({"closed_form": False}, "mesh"),
        ({"kind": SignatureKind.OFFSET}, "kind material"),
    ):
        parameters = replace(PARAMETERS, amplitudes=None, **changes)
        assert_abstains(classify(modal_signature(sequence, parameters), load_model()), why)
    flat = replace(modal_signature(sequence, PARAMETERS), lengths=(0.0, 0.0))
    assert_abstains(classify(flat, load_model()), "collapsed")


def test_two_frames_get_an_answer_or_a_reason() -> None:
    sequence = ventricle(MotionClass.NORMAL)
    two = mesh_sequence(sequence.vertices[[0, 10]], grid=(16, 40), topology="cup", unit="mm")
    found = answer(two)
    assert found.label is not None or "No class" in found.notes[0]


def test_a_signature_of_one_frame_as_reference_is_answered_with_a_note() -> None:
    sequence = ventricle(MotionClass.DYSSYNCHRONY)
    for reference in (0, 1):
        found = classify(modal_signature(sequence, replace(PARAMETERS, reference=reference)))
        assert found.label == MotionClass.DYSSYNCHRONY
        assert any("mean shape" in note for note in found.notes)


def test_a_sequence_is_fitted_as_the_model_asks() -> None:
    model = load_model()
    assert model.signature_parameters == SignatureParameters(modes=13, reference=MEAN)
    sequence = ventricle(MotionClass.DYSSYNCHRONY)
    one, other = answer(sequence), classify(modal_signature(sequence, PARAMETERS))
    assert np.array_equal(one.probabilities, other.probabilities)
    assert one.notes == other.notes
    assert not any("mean shape" in note for note in one.notes)
    assert model.readable.n_modes == len(lowest_modes(CUP, 13))


@pytest.mark.every(3)
@pytest.mark.parametrize("label", OFFSET.classes)
def test_offsets_are_read_where_nothing_is_said_of_the_points(label: MotionClass) -> None:
    for n_vertices in (None, 900):
        sequence = ventricle(label, n_vertices, noise=0.6)
        found, stated = (answer(sequence, one) for one in ("unknown", "offset"))
        assert found.model == stated.model == OFFSET_MODEL
        assert found.label == label
        assert "tracking=material" in found.notes[0]
        assert not any("tracking=material" in note for note in stated.notes)
        np.testing.assert_array_equal(found.probabilities, stated.probabilities)


def test_a_ventricle_has_one_class_in_every_form() -> None:
    sequence = ventricle(MotionClass.AKINESIA, noise=0.6)
    assert sequence.grid is not None
    model = load_model(OFFSET_MODEL)
    faces = lattice_faces(CUP, sequence.grid)
    x, times = sequence.vertices, sequence.times
    first = 3 * sequence.grid[1]
    forms = {
        "lattice": sequence,
        "triangles": mesh_sequence(x, faces, topology=CUP, times=times, unit="mm"),
        # Open at both ends, as some will state it.
        "cut lattice": mesh_sequence(
            x[:, first:], grid=(13, 40), topology=CYLINDER, times=times, unit="mm"
        ),
        "cut triangles": mesh_sequence(
            x[:, first:], lattice_faces(CYLINDER, (13, 40)), times=times, unit="mm"
        ),
        "mesh": ventricle(MotionClass.AKINESIA, 900, noise=0.6),
    }
    answers = {name: answer(form, "unknown") for name, form in forms.items()}
    assert {found.label for found in answers.values()} == {MotionClass.AKINESIA}
    for name in ("lattice", "cut lattice"):
        plain, triangles = answers[name], answers[name.replace("lattice", "triangles")]
        assert np.abs(plain.probabilities - triangles.probabilities).max() < 1e-6
    cut = forms["cut lattice"]
    assert model.readable.topologies == ("cup",)
    fitted = modal_signature(cut, model.signature_parameters)
    assert "topology=cup" in classify(fitted).notes[0]
    as_cup = modal_signature(cut, replace(model.signature_parameters, topology="cup"))
    assert classify(as_cup).label == MotionClass.AKINESIA


def test_points_that_are_material_are_read_as_such() -> None:
    found = answer(ventricle(MotionClass.REDUCED_TORSION), "material")
    assert (found.model, found.label) == (DEFAULT_MODEL, MotionClass.REDUCED_TORSION)


def test_the_model_of_offsets_offers_no_class_that_they_do_not_show() -> None:
    found = answer(ventricle(MotionClass.REDUCED_TORSION), "offset")
    assert MotionClass.REDUCED_TORSION not in found.classes
    assert found.label == MotionClass.NORMAL
    assert "do not show twist" in found.notes[0]


def test_a_signature_of_the_other_kind_is_refused_with_both_remedies() -> None:
    signature = modal_signature(ventricle(MotionClass.NORMAL), PARAMETERS)
    found = classify(replace(signature, facts=Facts()))
    assert found.flags == ("unreadable",)
    assert "kind=offset" in found.notes[0]
    assert "tracking=material" in found.notes[0]


def test_the_rule_stands_in_both_cards() -> None:
    for name in (DEFAULT_MODEL, OFFSET_MODEL):
        rule = load_model(name).card.extra["rule"]
        assert OFFSET_MODEL in rule
        assert "tracking=material" in rule
    assert shipped_for(f"{DEFAULT_MODEL}@1", Facts()) == f"{OFFSET_MODEL}@1"
    assert shipped_for(f"{DEFAULT_MODEL}@1", Facts(tracking="material")) == f"{DEFAULT_MODEL}@1"
    assert shipped_for("mine", Facts()) == "mine"


def test_a_real_ventricle_gets_an_answer_about_its_surface_alone(
    real_sequence: Callable[[str], MeshSequence],
) -> None:
    # It was fitted to contours and ejects 59 %.
    answers = {
        name: classify(real_sequence(f"heart/{name}"))
        for name in ("lv_grid_32x64", "lv_endocardium")
    }
    for found in answers.values():
        assert found.model == OFFSET_MODEL
        assert any("no patient" in note for note in found.notes)
        assert found.label != MotionClass.REDUCED_TORSION
        assert ("No class" if found.label is None else "tracking=material") in found.notes[0]
    # The same in either form: a plausible class, or none.
    assert {found.label for found in answers.values()} in ({None}, {MotionClass.NORMAL})


def test_a_cylinder_of_the_recipe_may_lack_rows_at_the_apex() -> None:
    grid, rng = (16, 8), np.random.default_rng(8)
    few = Acquisition(n_frames=2, noise=0.1)
    cases = [
        Case(
            simulate_ventricle(grid=grid, acquisition=few, rng=rng),
            MotionClass.NORMAL,
            VentricleParameters(),
        )
        for _ in range(8)
    ]
    cut = set()
    for case in cases:
        cup, cylinder = surfaces_of(case, 0.25)
        assert (cup.topology, cylinder.topology) == (CUP, CYLINDER)
        n = cylinder.n_vertices
        assert np.array_equal(cylinder.vertices, cup.vertices[:, -n:])
        assert cylinder.faces.max() == n - 1
        cut.add(grid[0] - n // grid[1])
        assert surfaces_of(case, 0.0)[1].n_vertices == cup.n_vertices
    assert len(cut) > 1
    assert max(cut) <= 4
