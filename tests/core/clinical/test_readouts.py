"""Volume and ejection fraction from a signature: exact where they can be, bounded where not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from clinical_cases import cohort, ejected, read, share, share_bound, share_range
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from solids import exact_volume
from template_surfaces import MAKERS

from modalmotion.clinical import Fraction, VolumeCurve, clinical_readouts
from modalmotion.errors import ParameterError, TopologyError
from modalmotion.mesh import Cavity, Facts, oriented_faces
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.pictures.readouts import volume_figure
from modalmotion.signature.making import modal_signature
from modalmotion.signature.reconstruction import at_times
from modalmotion.simulate import Acquisition, VentricleParameters, simulate_ventricle
from modalmotion.template import make_template
from modalmotion.template.body_frame import Components


@pytest.fixture(scope="module")
def beat() -> MeshSequence:
    return simulate_ventricle(
        VentricleParameters(motion_variation=2.0),
        n_vertices=400,
        acquisition=Acquisition(n_frames=12, noise=0.4),
        rng=np.random.default_rng(3),
    )


def own_volumes(sequence: MeshSequence, frames: slice = slice(None)) -> np.ndarray:
    faces = oriented_faces(make_template(sequence).faces, sequence.n_vertices)
    assert faces is not None
    v = np.array([exact_volume(x.astype(float), faces) for x in sequence.vertices[frames]])
    return v if v[0] > 0 else -v


@pytest.mark.parametrize(
    ("seconds", "facts", "is_noted"),
    [
        (0.8, Facts(cavity="lv"), False),
        (2.9, Facts(cavity="lv"), False),
        (800.0, Facts(cavity="lv"), True),
        (3.1, Facts(cavity="rv"), True),
        (800.0, Facts(), True),
        (800.0, Facts(cavity="none"), False),
        (0.8, Facts(cavity="lv", period=3.1), True),
        (None, Facts(cavity="lv"), False),
    ],
)
def test_a_beat_that_lasts_too_long_is_noted(
    beat: MeshSequence, seconds: float | None, facts: Facts, is_noted: bool
) -> None:
    times = None if seconds is None else np.linspace(0.0, seconds, beat.n_frames)
    found = read(replace(beat, times=times, facts=facts), modes=3)
    assert any("longer than any heartbeat" in note for note in found.notes) == is_noted


@pytest.mark.parametrize("components", list(Components))
def test_an_affine_motion_is_read_exactly(beat: MeshSequence, components: Components) -> None:
    # Even contraction, shear, lean: no few modes hold them, and the volume is a determinant.
    rng = np.random.default_rng(0)
    A = np.concatenate([np.eye(3)[None], np.eye(3) * 0.7 + 0.1 * rng.normal(size=(5, 3, 3))])
    moved = beat.vertices[0] @ A.transpose(0, 2, 1) + rng.normal(size=(6, 1, 3))
    sequence = mesh_sequence(moved, beat.faces, unit="mm")
    # Along the body a shear has wavenumber 2 in theta, which needs 18 modes.
    found = read(sequence, modes=18, components=components)
    scales = np.linalg.det(A)
    assert found.curve.volumes / found.curve.volumes[0] == pytest.approx(scales, rel=1e-10)
    assert share(found.curve) == pytest.approx(ejected(scales), abs=1e-8)
    assert share_bound(replace(found.curve, deviations=None)) < 1e-6
    if components == Components.CARTESIAN:
        assert share(read(sequence).curve) == pytest.approx(ejected(scales), abs=1e-8)


@pytest.mark.every(5)
@pytest.mark.parametrize("name", ["cup", "cylinder", "sphere", "torus"])
@pytest.mark.parametrize("parameters", [{}, {"topology": "mesh"}, {"modes": 1}, {"reference": 5}])
def test_the_bound_holds_for_every_surface(name: str, parameters: dict[str, object]) -> None:
    positions, faces = MAKERS[name](260, np.random.default_rng(1))
    sequence = mesh_sequence(positions, faces, unit="mm")
    found = read(sequence, **parameters)
    true = own_volumes(sequence)
    assert (np.abs(found.curve.volumes - true) <= found.curve.bounds).all()
    assert (np.abs(found.mesh_curve.volumes - true) <= found.mesh_curve.bounds).all()
    low, high = share_range(found.curve)
    assert low <= ejected(true) <= high
    for (least, most), value in (
        (found.curve.end_diastolic_range, true.max()),
        (found.curve.end_systolic_range, true.min()),
        (found.curve.stroke_range, np.ptp(true)),
    ):
        assert least <= value <= most


def test_the_bound_is_the_error_and_rounding(beat: MeshSequence) -> None:
    found = read(beat)
    error = np.abs(found.curve.volumes - own_volumes(beat))
    moved = error > 1.0
    assert moved.sum() >= 6
    assert found.curve.bounds[moved] == pytest.approx(error[moved], rel=1e-4)


def test_more_modes_end_at_the_mesh_itself() -> None:
    sequence = simulate_ventricle(
        grid=(6, 8), acquisition=Acquisition(n_frames=5, noise=0.5), rng=np.random.default_rng(0)
    )
    curves = (read(sequence, modes=k).curve for k in (7, 18, 48))
    errors = [share_bound(replace(curve, deviations=None)) for curve in curves]
    assert errors[2] < 1e-6 < min(errors[:2])


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=12, deadline=None)
def test_read_outs_do_not_depend_on_pose_winding_unit_or_numbering(seed: int) -> None:
    rng = np.random.default_rng(seed)
    positions, faces = MAKERS["cup"](200, np.random.default_rng(2))
    before = read(mesh_sequence(positions, faces, unit="mm"))
    R = Rotation.random(len(positions), rng=rng).as_matrix()
    moved = np.einsum("fij,fnj->fni", R, positions) + rng.normal(size=(len(positions), 1, 3)) * 30
    # The reference stays, for amplitudes are measured in its frame.
    moved[0] = positions[0]
    order = rng.permutation(positions.shape[1])
    place = np.argsort(order)
    turned = np.where(rng.random((len(faces), 1)) < 0.5, faces[:, ::-1], faces)
    after = read(mesh_sequence(moved[:, order] / 1000 + 1.0, place[turned], unit="m"))
    assert after.shown_in == pytest.approx(1e6)
    assert after.curve.volumes * after.shown_in == pytest.approx(
        before.curve.volumes * before.shown_in, rel=1e-6
    )
    assert share(after.curve) == pytest.approx(share(before.curve), abs=1e-5)


def test_far_from_the_origin_nothing_is_lost(beat: MeshSequence) -> None:
    far = mesh_sequence(beat.vertices.astype(float) + 1e6, beat.faces, unit="mm")
    near = read(beat)
    assert read(far).curve.volumes == pytest.approx(near.curve.volumes, rel=1e-8)
    assert near.curve.end_diastolic_volume * near.millilitres == pytest.approx(
        near.curve.end_diastolic_volume / 1000
    )


@pytest.mark.parametrize("scale", [1e-60, 1e60])
def test_extreme_units(beat: MeshSequence, scale: float) -> None:
    sized = mesh_sequence(beat.vertices.astype(float) * scale, beat.faces)
    assert share(read(sized).curve) == pytest.approx(share(read(beat).curve), rel=1e-9)
    with pytest.raises(ParameterError, match="unit is unknown"):
        _ = read(sized).millilitres
    too_far = mesh_sequence(beat.vertices.astype(float) * scale**3, beat.faces)
    with pytest.raises(ParameterError, match="double precision"):
        read(too_far)


def test_a_lattice_needs_no_triangles() -> None:
    sequence = simulate_ventricle(grid=(10, 16), acquisition=Acquisition(n_frames=8))
    bare = mesh_sequence(sequence.vertices, grid=(10, 16), topology="cup", unit="mm")
    found = read(bare)
    # The hole around the pole and the base.
    assert found.n_openings == 2
    assert found.mesh_curve.volumes == pytest.approx(
        Cavity(sequence.faces).volume(sequence.vertices.astype(float)), rel=1e-12
    )


def test_what_does_not_move_ejects_nothing(beat: MeshSequence) -> None:
    still = mesh_sequence(np.repeat(beat.vertices[:1], 4, axis=0), beat.faces)
    found = read(still)
    assert share(found.curve) == 0.0
    assert found.curve.stroke_volume == 0.0
    assert share_bound(replace(found.curve, deviations=None)) < 1e-6
    one = read(mesh_sequence(beat.vertices[:1], beat.faces))
    assert (one.curve.ejection_fraction, one.curve.volume_change, one.curve.share) == (None,) * 3
    assert (one.curve.share_range, one.curve.share_bound, one.mesh_curve.share) == (None,) * 3
    assert "only one frame" in one.notes[0]


def test_surfaces_without_an_inside_are_refused() -> None:
    positions, faces = MAKERS["plane"](120, np.random.default_rng(0))
    for sequence, words in (
        (mesh_sequence(positions, faces, topology="plane"), "encloses nothing"),
        (mesh_sequence(positions[:, :40], topology="open curve"), "no triangles"),
        (mesh_sequence(positions[:, :40], topology="closed curve"), "no triangles"),
    ):
        with pytest.raises(TopologyError, match=words) as caught:
            read(sequence)
        assert caught.value.remedy
    flat = positions * [1.0, 1.0, 0.0]
    with pytest.raises(TopologyError, match="no volume"):
        read(mesh_sequence(flat, faces), topology="mesh")


def test_a_surface_that_turns_inside_out_is_said(beat: MeshSequence) -> None:
    vertices = beat.vertices[[0, 0, 0]].astype(float)
    vertices[1] *= 0.9
    # Not a rigid motion: the mirror image.
    vertices[2, :, 0] *= -0.8
    found = read(mesh_sequence(vertices, beat.faces))
    assert "inside out" in found.notes[0]
    assert "impossible" in found.notes[0]
    for curve in (found.curve, found.mesh_curve):
        assert (curve.ejection_fraction, curve.volume_change, curve.share_range) == (None,) * 3
    # The remedy, followed.
    assert share(read(mesh_sequence(vertices[:2], beat.faces)).curve) > 0


def test_modes_that_turn_a_surface_inside_out_have_no_share(beat: MeshSequence) -> None:
    flatter = mesh_sequence(beat.vertices[[0, 0]] * [[[1, 1, 1]], [[0.3, 1, 1]]], beat.faces)
    signature = modal_signature(flatter)
    found = clinical_readouts(replace(signature, amplitudes=2 * signature.amplitudes), flatter)
    assert found.curve.volumes.min() < 0
    assert found.curve.share is None
    assert found.mesh_curve.ejection_fraction is not None
    assert "more modes" in found.notes[0]


def test_the_share_is_named_by_what_is_known() -> None:
    cup = mesh_sequence(*MAKERS["cup"](120, np.random.default_rng(1)))
    ball = mesh_sequence(*MAKERS["sphere"](120, np.random.default_rng(1)))
    for sequence, cavity, name in (
        (cup, "unknown", "ejection_fraction"),
        (cup, "none", "volume_change"),
        (ball, "unknown", "volume_change"),
        (ball, "none", "volume_change"),
        (ball, "la", "ejection_fraction"),
        (ball, "other", "ejection_fraction"),
    ):
        found = read(sequence.with_facts(Facts(cavity=cavity)))  # type: ignore[arg-type]
        for curve in (found.curve, found.mesh_curve):
            shares = {n: getattr(curve, n) for n in ("ejection_fraction", "volume_change")}
            assert {n for n, value in shares.items() if value is not None} == {name}
            assert shares[name] == curve.share
        told = any("State the fact cavity" in note for note in found.notes)
        assert told == (name == "volume_change")
        assert share(read(sequence).curve) == share(found.curve)


@pytest.mark.parametrize("seed", range(6))
def test_a_share_lies_between_0_and_100_percent_however_wild_the_motion(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices, faces = MAKERS["sphere"](90, rng)
    # Limbs that fold: few modes hold little of it, and their volume may be of any sign.
    fold = 1 + 0.6 * rng.normal(size=(len(vertices), 1, 3)) * np.sin(vertices[:1, :, [1, 2, 0]] / 9)
    found = read(mesh_sequence(vertices * fold, faces), modes=4)
    for curve in (found.curve, found.mesh_curve):
        if curve.share_range is not None:
            low, high = curve.share_range
            assert 0 <= low <= share(curve) <= high <= 100
        else:
            assert any("impossible" in note for note in found.notes)


def test_another_sequence_or_other_times_are_refused(beat: MeshSequence) -> None:
    signature = modal_signature(beat)
    with pytest.raises(ParameterError, match="another sequence"):
        clinical_readouts(signature, mesh_sequence(beat.vertices * 1.01, beat.faces))
    timed = replace(signature, times=np.linspace(0.0, 11.0, 12).astype(np.float64))
    with pytest.raises(ParameterError, match="between frames"):
        clinical_readouts(at_times(timed, np.array([0.5, 1.5])), beat)


@given(
    volumes=st.lists(st.floats(1, 100), min_size=1, max_size=6),
    seed=st.integers(0, 2**32 - 1),
    spread=st.floats(0, 60),
)
@settings(max_examples=60)
def test_intervals_hold_whatever_the_truth_within_the_bounds(
    volumes: list[float], seed: int, spread: float
) -> None:
    rng = np.random.default_rng(seed)
    v = np.array(volumes)
    bounds = spread * rng.random(len(v))
    curve = VolumeCurve(v, bounds, Fraction.VOLUME_CHANGE)
    low, high = share_range(curve)
    assert 0 <= low <= share(curve) <= high <= 100
    for _ in range(20):
        # Corners and inside.
        true = v + bounds * np.clip(rng.normal(size=len(v)) * 2, -1, 1)
        assert curve.stroke_range[0] - 1e-9 <= np.ptp(true) <= curve.stroke_range[1] + 1e-9
        # A surface that does not turn inside out.
        if true.min() <= 0:
            continue
        assert low - 1e-9 <= ejected(true) <= high + 1e-9


def test_simulated_ventricles_are_read_within_their_bounds() -> None:
    errors = []
    for sequence in cohort(2, seed=11):
        found = read(sequence)
        true = own_volumes(sequence) if sequence.n_vertices < 1000 else found.mesh_curve.volumes
        assert (np.abs(found.curve.volumes - true) <= found.curve.bounds).all()
        errors.append(abs(share(found.curve) - ejected(true)))
        assert errors[-1] <= share_bound(found.curve) + 1e-9
    assert np.median(errors) < 0.5
    # A wall that lost its motion in one place is what few modes are worst at.
    assert np.mean(np.array(errors) <= 1.5) >= 0.8


@pytest.mark.soak
def test_200_simulated_ventricles_are_read_within_their_bounds() -> None:
    errors, bounds = [], []
    for sequence in cohort(40, seed=5):
        found = read(sequence)
        part = slice(None, None, max(1, sequence.n_frames // 4))
        true = own_volumes(sequence, part)
        assert (np.abs(found.curve.volumes[part] - true) <= found.curve.bounds[part]).all()
        own = found.mesh_curve.volumes
        errors.append(abs(share(found.curve) - ejected(own)))
        bounds.append(share_bound(found.curve))
    assert len(errors) == 200
    assert (np.array(errors) <= np.array(bounds)).all()
    assert np.median(bounds) <= 5 * np.median(errors)


@pytest.fixture(scope="module")
def real_share(real_sequence: Callable[[str], MeshSequence]) -> Callable[[str], float]:
    """Ejected share of a real sequence by the volumes of its meshes."""
    return cache(lambda name: ejected(own_volumes(real_sequence(f"heart/{name}"))))


@pytest.mark.every(3)
@pytest.mark.parametrize("name", ["lv_grid_32x64", "lv_endocardium"])
@pytest.mark.parametrize("components", list(Components))
def test_a_real_ventricle_within_a_point_and_a_half(
    real_sequence: Callable[[str], MeshSequence],
    real_share: Callable[[str], float],
    name: str,
    components: Components,
) -> None:
    found = read(real_sequence(f"heart/{name}"), components=components)
    assert found.n_amplitudes == 21
    true = real_share(name)
    assert abs(share(found.curve) - true) <= 1.5
    assert share_range(found.curve)[0] <= true + 1e-9
    assert true - 1e-9 <= share_range(found.curve)[1]


def test_the_picture_says_what_was_read(beat: MeshSequence) -> None:
    found = read(beat)
    figure = volume_figure(found)
    (axes,) = figure.axes
    assert f"{share(found.curve):.1f} %" in axes.get_title()
    line = axes.get_lines()[0]
    assert np.asarray(line.get_ydata()) == pytest.approx(found.curve.volumes / 1000)


@pytest.mark.parametrize(("unit", "is_likely"), [("mm", True), ("cm", False), ("m", False)])
def test_a_unit_that_makes_a_ventricle_of_a_house_is_told(
    beat: MeshSequence, unit: str, is_likely: bool
) -> None:
    notes = read(replace(beat, unit=unit)).notes
    assert any("check the unit" in note for note in notes) != is_likely


def test_an_unknown_unit_is_not_judged(beat: MeshSequence) -> None:
    assert not read(replace(beat, unit=None)).notes
