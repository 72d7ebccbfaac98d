"""The dynamical matrix against the whole lattice's matrix, node by node."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from modalmotion.errors import ParameterError, ShapeError, TopologyError
from modalmotion.modes import (
    HarmonicPotential,
    dynamical_matrices,
    polarised_waves,
    wave_field,
)
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topology import CLOSED, CLOSED_CURVE, CYLINDER, TORUS, Topology

CUBE = Topology((CLOSED, CLOSED, CLOSED))
Constants = dict[tuple[int, ...], NDArray[np.float64]]


def springs(directions: list[tuple[int, ...]], seed: int) -> Constants:
    """Force constants of springs that resist any stretch, some directions more than others."""
    rng = np.random.default_rng(seed)
    constants = {}
    for offset in directions:
        A = rng.normal(size=(3, 3))
        constants[offset] = -(A @ A.T)
    return constants


def gyrating(seed: int) -> Constants:
    """A stable potential whose force constants are not symmetric: V = sum |B(u)|^2 / 2."""
    rng = np.random.default_rng(seed)
    # B(u)_n = b0 (u_n - u_(n + e)) + b1 (u_n - u_(n + f)): its square couples e and f.
    b, offsets = rng.normal(size=(2, 3, 3)), [(1, 0), (0, 1)]
    terms = {(0, 0): b[0] + b[1], offsets[0]: -b[0], offsets[1]: -b[1]}
    constants: Constants = {}
    for (i, P), (k, Q) in product(terms.items(), terms.items()):
        offset = tuple(there - here for here, there in zip(i, k, strict=True))
        constants[offset] = constants.get(offset, np.zeros((3, 3))) + P.T @ Q
    return constants


def dense(potential: HarmonicPotential) -> NDArray[np.float64]:
    """The matrix of all nodes and directions, neighbour by neighbour, wrapped around."""
    shape, n = potential.shape, int(np.prod(potential.shape))
    matrix = np.zeros((n, 3, n, 3))
    for node in product(*(range(size) for size in shape)):
        here = np.ravel_multi_index(node, shape)
        for offset, K in potential.force_constants.items():
            there = [(i + j) % size for i, j, size in zip(node, offset, shape, strict=True)]
            matrix[here, :, np.ravel_multi_index(there, shape), :] += K
    return matrix.reshape(3 * n, 3 * n) / potential.mass


def every_wave(shape: tuple[int, ...]) -> NDArray[np.int64]:
    return np.array(list(product(*(range(n) for n in shape))), dtype=np.int64)


POTENTIALS = [
    HarmonicPotential(CLOSED_CURVE, (7,), springs([(1,), (2,)], 0), 0.6),
    HarmonicPotential(CLOSED_CURVE, (1,), springs([(1,)], 1)),
    HarmonicPotential(CLOSED_CURVE, (2,), springs([(1,), (3,)], 2)),
    HarmonicPotential(TORUS, (4, 5), springs([(1, 0), (0, 1), (1, 1), (1, -1)], 3), 2.0),
    HarmonicPotential(TORUS, (5, 6), gyrating(4)),
    HarmonicPotential(CUBE, (3, 2, 4), springs([(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)], 5)),
]


@pytest.mark.parametrize("potential", POTENTIALS)
def test_frequencies_are_those_of_the_whole_lattice(potential: HarmonicPotential) -> None:
    slow = np.linalg.eigvalsh(dense(potential))
    fast = polarised_waves(potential, every_wave(potential.shape)).angular_frequencies
    assert np.sort((fast**2).ravel()) == pytest.approx(slow, abs=1e-13 * max(slow.max(), 1e-300))


@pytest.mark.parametrize("potential", POTENTIALS)
def test_waves_solve_the_equations_of_every_node(potential: HarmonicPotential) -> None:
    matrix = dense(potential)
    wavenumbers = every_wave(potential.shape)
    waves = polarised_waves(potential, wavenumbers)
    fields = []
    for p, w, e in zip(wavenumbers.tolist(), *waves, strict=True):
        for branch in range(3):
            field = wave_field(potential, tuple(p), e[:, branch]).ravel()
            residual = matrix @ field - w[branch] ** 2 * field
            assert np.abs(residual).max() <= 1e-13 * max(np.abs(matrix).max(), 1)
            fields.append(field)
    # They are orthogonal, and as many as there are directions at nodes: complete.
    gram = np.conj(fields) @ np.transpose(fields) * 3 / len(fields)
    assert gram == pytest.approx(np.eye(len(fields)), abs=1e-13)


@pytest.mark.parametrize("potential", POTENTIALS)
def test_dynamical_matrices_are_hermitian_and_those_of_opposite_waves_conjugate(
    potential: HarmonicPotential,
) -> None:
    wavenumbers = every_wave(potential.shape)
    D = dynamical_matrices(potential, wavenumbers)
    assert np.array_equal(D, D.conj().transpose(0, 2, 1))
    assert np.array_equal(dynamical_matrices(potential, -wavenumbers), D.conj())
    assert not D[0].any()
    there = polarised_waves(potential, wavenumbers).angular_frequencies
    back = polarised_waves(potential, -wavenumbers).angular_frequencies
    assert back == pytest.approx(there, rel=1e-13, abs=1e-13)


def test_dynamical_matrix_is_the_sum_over_neighbours() -> None:
    potential = POTENTIALS[4]
    p = np.array([[1, 2], [4, 5], [3, 0]])
    naive = np.zeros((3, 3, 3), dtype=complex)
    for offset, K in potential.force_constants.items():
        phase = 2 * np.pi * (p / potential.shape) @ np.array(offset)
        naive += np.exp(1j * phase)[:, None, None] * K / potential.mass
    D = dynamical_matrices(potential, p)
    assert pytest.approx(naive, abs=1e-13) == D
    assert np.abs(D.imag).max() >= 0.1


def test_diagonal_force_constants_are_the_decoupled_lattice() -> None:
    lattice = Lattice(TORUS, (6, 9), (2.0, 0.3), 0.7)
    modes = lattice.all_modes()
    waves = polarised_waves(HarmonicPotential.decoupled(lattice), modes.wavenumbers)
    w = lattice.angular_frequencies(modes)
    for branch in range(3):
        assert waves.angular_frequencies[:, branch] == pytest.approx(w, rel=1e-15, abs=0)
    assert np.array_equal(waves.polarisations, np.broadcast_to(np.eye(3), (54, 3, 3)))
    # Unlike stiffness in x, y, z: three lattices, each direction by itself.
    K = np.array([0.5, 3.0, 1.0])
    potential = HarmonicPotential(TORUS, (6, 9), {(1, 0): -np.diag(K), (0, 1): -np.diag(2 * K)})
    found = polarised_waves(potential, modes.wavenumbers)
    for direction, (stiffness, branch) in enumerate(zip(K, (0, 2, 1), strict=True)):
        alone = Lattice(TORUS, (6, 9), (stiffness, 2 * stiffness)).angular_frequencies(modes)
        assert found.angular_frequencies[:, branch] == pytest.approx(alone, rel=2e-15, abs=0)
        assert np.array_equal(found.polarisations[1:, direction, branch], np.ones(53))


def test_long_waves_on_a_huge_lattice_keep_their_digits() -> None:
    n = 10**8
    potential = HarmonicPotential(CLOSED_CURVE, (n,), {(1,): -np.diag([1.0, 2.0, 3.0])})
    w = polarised_waves(potential, np.array([[1]])).angular_frequencies[0]
    expected = 2 * np.sqrt([1.0, 2.0, 3.0]) * np.sin(np.pi / n)
    assert w == pytest.approx(expected, rel=1e-14, abs=0)
    naive = 2 - 2 * np.cos(2 * np.pi / n)
    assert abs(naive / expected[0] ** 2 - 1) >= 0.01


def test_polarisations_have_a_fixed_phase() -> None:
    for potential in POTENTIALS:
        e = polarised_waves(potential, every_wave(potential.shape)).polarisations
        size = np.abs(e)
        largest = (size >= size.max(axis=1, keepdims=True) * (1 - 1e-9)).argmax(axis=1)
        entry = np.take_along_axis(e, largest[:, None, :], axis=1)
        assert (entry.real > 0).all()
        assert np.abs(entry.imag).max() <= 1e-15
        assert np.conj(e.transpose(0, 2, 1)) @ e == pytest.approx(
            np.broadcast_to(np.eye(3), e.shape), abs=1e-14
        )
    # Symmetric force constants have real polarisations.
    real = polarised_waves(POTENTIALS[3], every_wave((4, 5))).polarisations
    assert np.abs(real.imag).max() <= 1e-14


def test_missing_force_constants_are_filled_in() -> None:
    rng = np.random.default_rng(6)
    K = -np.eye(3) + 0.1 * rng.normal(size=(3, 3))
    short = HarmonicPotential(CLOSED_CURVE, (5,), {(1,): K})
    own = -(K + K.T)
    long = HarmonicPotential(CLOSED_CURVE, (5,), {(1,): K, (-1,): K.T, (0,): own})
    p = np.arange(5)[:, None]
    assert np.array_equal(dynamical_matrices(short, p), dynamical_matrices(long, p))
    # Acoustic sum rule: the constants of all offsets together are zero.
    for potential in (short, *POTENTIALS):
        total = np.sum(list(potential.force_constants.values()), axis=0)
        assert np.abs(total).max() <= 1e-13
        slowest = polarised_waves(potential, every_wave(potential.shape)[:1])
        assert not slowest.angular_frequencies.any()


@pytest.mark.parametrize(
    ("constants", "reason"),
    [
        ({(1,): -np.eye(3), (-1,): -2 * np.eye(3)}, "not the transpose"),
        ({(1,): np.triu(-np.ones((3, 3))), (-1,): np.triu(-np.ones((3, 3)))}, "not the transpose"),
        ({(1,): -np.eye(3), (0,): 2.5 * np.eye(3)}, "sum rule"),
        ({(1,): -np.eye(2)}, "shape"),
        ({(1, 0): -np.eye(3)}, "offset"),
        ({(1,): np.full((3, 3), np.nan)}, "finite"),
    ],
)
def test_what_is_no_potential_is_refused(constants: Constants, reason: str) -> None:
    with pytest.raises(ParameterError, match=reason):
        HarmonicPotential(CLOSED_CURVE, (5,), constants)


def test_unstable_potentials_are_refused_with_their_wave() -> None:
    # Next neighbours pull apart: long waves would grow, and short ones too.
    repelling = HarmonicPotential(CLOSED_CURVE, (6,), {(1,): np.diag([-1.0, -1.0, 0.2])})
    with pytest.raises(ParameterError, match=r"\(1,\)") as caught:
        polarised_waves(repelling, np.array([[0], [1], [2]]))
    assert caught.value.details["wavenumbers"] == [1]
    barely = HarmonicPotential(CLOSED_CURVE, (6,), {(1,): np.diag([-1.0, -1.0, 1e-12])})
    with pytest.raises(ParameterError):
        polarised_waves(barely, np.array([[1]]))
    # A string without tension has no force across it, which is no instability.
    slack = HarmonicPotential(CLOSED_CURVE, (6,), {(1,): -np.outer([1, 2, 2], [1, 2, 2]) / 9})
    w = polarised_waves(slack, every_wave((6,))).angular_frequencies
    assert w[:, :2] == pytest.approx(np.zeros((6, 2)), abs=1e-7)
    assert w[:, 2] == pytest.approx(2 * np.sin(np.pi * np.arange(6) / 6), abs=1e-14)


def test_other_wrong_input_is_refused() -> None:
    with pytest.raises(TopologyError):
        HarmonicPotential(CYLINDER, (4, 5), {(1, 0): -np.eye(3)})
    with pytest.raises(TopologyError):
        HarmonicPotential.decoupled(Lattice(CYLINDER, (4, 5)))
    for mass in (0.0, -1.0, np.nan):
        with pytest.raises(ParameterError):
            HarmonicPotential(CLOSED_CURVE, (4,), {(1,): -np.eye(3)}, mass)
    with pytest.raises(ShapeError):
        HarmonicPotential(CLOSED_CURVE, (0,), {(1,): -np.eye(3)})
    wrong: list[NDArray[Any]] = [np.zeros((3, 2), int), np.zeros((3, 1)), np.zeros(3, int)]
    for wavenumbers in wrong:
        with pytest.raises(ShapeError):
            dynamical_matrices(POTENTIALS[0], wavenumbers)


@pytest.mark.parametrize(
    ("constant", "mass"), [(1e308, 1.0), (1e299, 1e-10), (1.0, 1e-310), (1e200, 1e-200)]
)
def test_constants_whose_frequencies_are_no_numbers_are_refused(
    constant: float, mass: float
) -> None:
    K = -constant * np.eye(3)
    with pytest.raises(ParameterError, match="beyond the largest number"):
        HarmonicPotential(TORUS, (4, 4), {(1, 0): K, (0, 1): K}, mass)
