from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from modalmotion.errors import ModeCountError, ParameterError, TopologyError
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes import ModeSet
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CUP, CYLINDER, lattice_coordinates
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import reconstruct
from modalmotion.template import make_template

SHAPE = (12, 16)


def bowl() -> NDArray[np.float64]:
    """A cup-shaped lattice, (nodes, 3), mm."""
    s, theta = lattice_coordinates(CUP, SHAPE).T
    r, height = 25 * np.sin(1.8 * s), 60 * (1 - np.cos(1.8 * s))
    turn = 2 * np.pi * theta
    return np.stack([r * np.cos(turn), 1.3 * r * np.sin(turn), height + 4 * r / 25], axis=1)


def moving_bowl(rng: np.random.Generator, n_frames: int = 5, size: float = 3.0) -> MeshSequence:
    lattice = Lattice(CUP, SHAPE)
    shapes = lattice.shapes(lattice.whole_modes(18))
    amplitudes = rng.normal(size=(n_frames, shapes.shape[1], 3)) * size
    amplitudes[0] = 0.0
    return mesh_sequence(bowl() + shapes @ amplitudes, grid=SHAPE, topology=CUP, unit="mm")


def naive(sequence: MeshSequence, n_modes: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Amplitudes and residuals with uniform weights, rotation kept: a sum for each."""
    lattice = Lattice(CUP, SHAPE)
    shapes = lattice.shapes(lattice.lowest_modes(n_modes))
    u = sequence.vertices - sequence.vertices[0]
    a = np.array([shapes.T @ frame / len(shapes) for frame in u])
    return a, u - np.array([shapes @ frame for frame in a])


def test_amplitudes_and_errors_equal_the_naive_sums(rng: np.random.Generator) -> None:
    sequence = moving_bowl(rng)
    template = replace(make_template(sequence), weights=np.full(192, 1 / 192))
    asked = SignatureParameters(template=template.id, remove_rotation=False)
    signature = modal_signature(sequence, asked, template=template)
    a, residual = naive(sequence, 7)
    distance = np.linalg.norm(residual, axis=2)
    assert signature.amplitudes == pytest.approx(a, abs=1e-12)
    assert signature.rms_errors == pytest.approx(np.sqrt((distance**2).mean(axis=1)), abs=1e-12)
    assert signature.max_errors == pytest.approx(distance.max(axis=1), abs=1e-12)
    ranked = np.sort(distance, axis=1)[:, int(np.ceil(0.95 * distance.shape[1])) - 1]
    assert signature.p95_errors == pytest.approx(ranked, abs=1e-12)
    assert signature.rms_error == pytest.approx(np.sqrt((distance**2).mean()), abs=1e-12)


def test_motion_made_of_modes_is_found_again(rng: np.random.Generator) -> None:
    sequence = moving_bowl(rng)
    signature = modal_signature(sequence, SignatureParameters(modes=18, remove_rotation=False))
    assert signature.max_error < 1e-11
    spectrum = np.sqrt((signature.amplitudes**2).sum(axis=2).mean(axis=0))
    assert signature.deformation_spectrum == pytest.approx(spectrum)


@pytest.mark.parametrize("n_modes", [1, 7, 18])
def test_the_stated_error_is_the_distance_to_the_reconstruction(
    rng: np.random.Generator, n_modes: int
) -> None:
    sequence = moving_bowl(rng)
    signature = modal_signature(sequence, SignatureParameters(modes=n_modes))
    distance = np.linalg.norm(reconstruct(signature, sequence) - sequence.vertices, axis=2)
    assert distance.max(axis=1) == pytest.approx(signature.max_errors, abs=1e-12)
    assert np.sqrt((distance**2).mean(axis=1))[0] == pytest.approx(0.0, abs=1e-12)


def test_more_modes_never_leave_more(rng: np.random.Generator) -> None:
    sequence = moving_bowl(rng)
    errors = [
        modal_signature(sequence, SignatureParameters(modes=n)).rms_error
        for n in (1, 2, 4, 7, 18, 37)
    ]
    assert errors == sorted(errors, reverse=True)


def test_a_translation_excites_only_the_first_mode(rng: np.random.Generator) -> None:
    path = rng.normal(size=(4, 1, 3)) * 10
    signature = modal_signature(mesh_sequence(bowl() + path, grid=SHAPE, topology=CUP, unit="mm"))
    assert signature.amplitudes[:, 0] == pytest.approx((path - path[0])[:, 0], abs=1e-12)
    assert np.abs(signature.amplitudes[:, 1:]).max() < 1e-12
    assert signature.max_error < 1e-12


@pytest.mark.parametrize("degrees", [1, 10, 30, 90, 179.9, 180])
def test_a_rotation_alone_is_no_deformation(degrees: float) -> None:
    axis = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    R = Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix()
    centre = modal_signature(mesh_sequence(bowl()[None], grid=SHAPE, topology=CUP))
    signature = modal_signature(
        mesh_sequence(np.stack([bowl(), bowl() @ R.T]), grid=SHAPE, topology=CUP)
    )
    assert np.abs(signature.amplitudes[:, 1:]).max() < 1e-11
    assert signature.rotations.matrices[1] == pytest.approx(R, abs=1e-12)
    assert centre.n_frames == 1


def test_a_start_angle_only_turns_each_pair(rng: np.random.Generator) -> None:
    sequence = moving_bowl(rng)
    turned = np.roll(sequence.vertices.reshape(-1, *SHAPE, 3), 3, axis=2).reshape(-1, 192, 3)
    a = modal_signature(sequence)
    b = modal_signature(mesh_sequence(turned, grid=SHAPE, topology=CUP, unit="mm"))
    assert isinstance(a.modes, ModeSet)
    p = a.modes.wavenumbers[:, 1]
    for mode in range(len(a.modes)):
        if a.modes.is_sine[mode]:
            phi = 2 * np.pi * p[mode] * 3 / SHAPE[1]
            c, s = a.amplitudes[:, mode - 1], a.amplitudes[:, mode]
            turned_pair = (c * np.cos(phi) - s * np.sin(phi), c * np.sin(phi) + s * np.cos(phi))
            assert b.amplitudes[:, mode - 1] == pytest.approx(turned_pair[0], abs=1e-12)
            assert b.amplitudes[:, mode] == pytest.approx(turned_pair[1], abs=1e-12)
        elif p[mode] == 0:
            assert b.amplitudes[:, mode] == pytest.approx(a.amplitudes[:, mode], abs=1e-12)


@pytest.mark.parametrize("factor", [1e-200, 1e-12, 1e-3, 1e3, 1e12, 1e200])
def test_amplitudes_scale_with_the_unit(rng: np.random.Generator, factor: float) -> None:
    sequence = moving_bowl(rng)
    scaled = mesh_sequence(sequence.vertices * factor, grid=SHAPE, topology=CUP)
    a, b = modal_signature(sequence), modal_signature(scaled)
    assert b.amplitudes / factor == pytest.approx(a.amplitudes, rel=1e-10, abs=1e-12)
    assert b.rms_error / factor == pytest.approx(a.rms_error, rel=1e-10)
    assert b.deformation_spectrum / factor == pytest.approx(a.deformation_spectrum, rel=1e-10)


def test_a_static_sequence_has_exactly_no_motion() -> None:
    signature = modal_signature(
        mesh_sequence(np.repeat(bowl()[None], 4, axis=0), grid=SHAPE, topology=CUP)
    )
    assert not signature.amplitudes.any()
    assert signature.max_error == signature.rms_error == 0.0
    assert not signature.strain_energy.any()
    assert any("Nothing moves" in note for note in signature.notes)


def test_a_single_frame_is_flagged() -> None:
    signature = modal_signature(mesh_sequence(bowl()[None], grid=SHAPE, topology=CUP))
    assert not signature.amplitudes.any()
    assert any("only one frame" in note for note in signature.notes)


def test_float32_far_from_the_origin_is_flagged_and_float64_is_exact(
    rng: np.random.Generator,
) -> None:
    sequence = moving_bowl(rng)
    near = modal_signature(sequence)
    far = modal_signature(mesh_sequence(sequence.vertices + 1e6, grid=SHAPE, topology=CUP))
    assert far.amplitudes == pytest.approx(near.amplitudes, abs=1e-8)
    rounded = mesh_sequence((sequence.vertices + 1e6).astype(np.float32), grid=SHAPE, topology=CUP)
    assert any("float32" in note for note in modal_signature(rounded).notes)
    assert not any("float32" in note for note in near.notes)


def test_a_count_that_splits_a_pair_is_rounded_up_and_says_so() -> None:
    sequence = mesh_sequence(bowl()[None], grid=SHAPE, topology=CUP)
    signature = modal_signature(sequence, SignatureParameters(modes=17))
    assert len(signature.modes) == 18
    assert any("54 amplitudes" in note for note in signature.notes)


def test_the_papers_compression_ratios() -> None:
    # Nastar 1994, figure 1: 4,000 nodes, 3, 21 and 51 amplitudes. 51 would split a pair.
    s_and_theta = lattice_coordinates(CYLINDER, (50, 80))
    sequence = mesh_sequence(
        np.concatenate([s_and_theta, np.ones((4000, 1))], axis=1)[None],
        grid=(50, 80),
        topology=CYLINDER,
    )
    ratios = {
        n: modal_signature(sequence, SignatureParameters(modes=n)).compression for n in (1, 7)
    }
    assert ratios == {1: 4000, 7: pytest.approx(571, abs=0.5)}
    assert pytest.approx(235, abs=0.5) == 4000 * 3 / 51
    rounded = modal_signature(sequence, SignatureParameters(modes=17))
    assert rounded.compression == pytest.approx(4000 / 18)


def test_energy_and_frequencies_follow_the_continuum(rng: np.random.Generator) -> None:
    signature = modal_signature(moving_bowl(rng), SignatureParameters())
    length, circumference = signature.lengths
    by_label = dict(
        zip(map(str, signature.modes.labels), signature.angular_frequencies, strict=True)
    )
    assert by_label["(0, 0, cos)"] == 0.0
    assert by_label["(1, 0, cos)"] == pytest.approx(np.pi / length)
    # p' = 1 takes the half-integer family at the pole: 1/2 and 3/2 half periods along s.
    first = np.hypot(0.5 * np.pi / length, 2 * np.pi / circumference)
    assert by_label["(0, 1, sin)"] == pytest.approx(first)
    odd = np.hypot(1.5 * np.pi / length, 2 * np.pi / circumference)
    assert by_label["(1, 1, cos)"] == pytest.approx(odd)
    expected = 0.5 * signature.angular_frequencies**2 * (signature.amplitudes**2).sum(axis=2)
    assert signature.strain_energy == pytest.approx(expected)


@pytest.mark.parametrize(
    ("parameters", "error", "words"),
    [
        ({"modes": 0}, ModeCountError, "0 modes"),
        ({"modes": 100_000}, ModeCountError, "100000"),
        ({"reference": 9}, ParameterError, "frame 9"),
        ({"reference": -1}, ParameterError, "frame -1"),
        ({"modes": 193}, ModeCountError, "192"),
        ({"topology": "moebius"}, TopologyError, "moebius"),
    ],
)
def test_parameters_out_of_range_are_refused(
    rng: np.random.Generator,
    parameters: dict[str, float],
    error: type[Exception],
    words: str,
) -> None:
    with pytest.raises(error, match=words):
        modal_signature(moving_bowl(rng), SignatureParameters(**parameters))  # type: ignore[arg-type]


def test_a_lattice_without_a_topology_is_asked_for_one() -> None:
    with pytest.raises(TopologyError, match="has no topology"):
        modal_signature(mesh_sequence(bowl()[None], grid=SHAPE))


def test_another_sequence_cannot_be_reconstructed(rng: np.random.Generator) -> None:
    one, other = moving_bowl(rng), moving_bowl(rng)
    with pytest.raises(ParameterError, match="another sequence"):
        reconstruct(modal_signature(one), other)


def _uniform_rms(signature: ModalSignature, sequence: MeshSequence) -> float:
    distance = reconstruct(signature, sequence) - sequence.vertices
    return float(np.sqrt((distance**2).sum(axis=2).mean()))


@pytest.mark.parametrize(
    ("name", "topology", "modes", "bound_mm"),
    [
        ("heart/lv_grid_32x64", "cup", 7, 1.30),
        ("heart/lv_grid_32x64", "cylinder", 7, 1.46),
        ("heart/lv_grid_32x64", "cup", 18, 0.95),
        ("heart/lv_grid_32x64", "cylinder", 18, 0.95),
        ("heart/lv_endocardium", None, 7, 1.55),
    ],
)
def test_error_on_the_real_ventricle(
    real_sequence: Callable[[str], MeshSequence],
    name: str,
    topology: str | None,
    modes: int,
    bound_mm: float,
) -> None:
    sequence = real_sequence(name)
    by_area = modal_signature(sequence, SignatureParameters(modes=modes, topology=topology))
    assert by_area.weighted_rms_error <= bound_mm
    assert by_area.rms_error == pytest.approx(_uniform_rms(by_area, sequence), rel=1e-9)
    assert float(np.sqrt((by_area.motion_rms**2).mean())) > 5.0
