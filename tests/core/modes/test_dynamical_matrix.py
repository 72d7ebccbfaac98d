"""The dynamical matrix against the whole lattice's matrix, node by node."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.modes import dynamical_matrices, polarised_waves
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import TORUS

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
    # One of each pair of opposite offsets.
    return {offset: K for offset, K in constants.items() if offset > (0, 0)}


Potential = tuple[tuple[int, ...], Constants, float]


def all_constants(constants: Constants) -> Constants:
    """Those of the opposite offsets, and of offset 0, too."""
    whole = {**constants, **{tuple(-i for i in n): K.T for n, K in constants.items()}}
    return {**whole, (0,) * len(next(iter(constants))): -np.sum(list(whole.values()), axis=0)}


def dense(potential: Potential) -> NDArray[np.float64]:
    """The matrix of all nodes and directions, neighbour by neighbour, wrapped around."""
    shape, constants, mass = potential
    n = int(np.prod(shape))
    matrix = np.zeros((n, 3, n, 3))
    for node in product(*(range(size) for size in shape)):
        here = np.ravel_multi_index(node, shape)
        for offset, K in all_constants(constants).items():
            there = [(i + j) % size for i, j, size in zip(node, offset, shape, strict=True)]
            matrix[here, :, np.ravel_multi_index(there, shape), :] += K
    return matrix.reshape(3 * n, 3 * n) / mass


def every_wave(shape: tuple[int, ...]) -> NDArray[np.int64]:
    return np.array(list(product(*(range(n) for n in shape))), dtype=np.int64)


POTENTIALS: list[Potential] = [
    ((7,), springs([(1,), (2,)], 0), 0.6),
    ((1,), springs([(1,)], 1), 1.0),
    ((2,), springs([(1,), (3,)], 2), 1.0),
    ((4, 5), springs([(1, 0), (0, 1), (1, 1), (1, -1)], 3), 2.0),
    ((5, 6), gyrating(4), 1.0),
    ((3, 2, 4), springs([(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)], 5), 1.0),
]


def waves_of(potential: Potential, wavenumbers: NDArray[np.int64]) -> tuple[Any, Any]:
    shape, constants, mass = potential
    return polarised_waves(shape, constants, wavenumbers, mass)


def matrices_of(potential: Potential, wavenumbers: NDArray[Any]) -> NDArray[np.complex128]:
    shape, constants, mass = potential
    return dynamical_matrices(shape, constants, wavenumbers, mass)


@pytest.mark.parametrize("potential", POTENTIALS)
def test_frequencies_are_those_of_the_whole_lattice(potential: Potential) -> None:
    slow = np.linalg.eigvalsh(dense(potential))
    fast = waves_of(potential, every_wave(potential[0]))[0]
    assert np.sort((fast**2).ravel()) == pytest.approx(slow, abs=1e-13 * max(slow.max(), 1e-300))


@pytest.mark.parametrize("potential", POTENTIALS)
def test_waves_solve_the_equations_of_every_node(potential: Potential) -> None:
    matrix = dense(potential)
    wavenumbers = every_wave(potential[0])
    waves = waves_of(potential, wavenumbers)
    fields = []
    for p, w, e in zip(wavenumbers.tolist(), *waves, strict=True):
        for branch in range(3):
            node = np.indices(potential[0]).reshape(len(p), -1) + 1
            phase = 2 * np.pi * (np.array(p) / potential[0]) @ node
            field = (np.exp(1j * phase)[:, None] * e[:, branch]).ravel()
            residual = matrix @ field - w[branch] ** 2 * field
            assert np.abs(residual).max() <= 1e-13 * max(np.abs(matrix).max(), 1)
            fields.append(field)
    # They are orthogonal, and as many as there are directions at nodes: complete.
    gram = np.conj(fields) @ np.transpose(fields) * 3 / len(fields)
    assert gram == pytest.approx(np.eye(len(fields)), abs=1e-13)


@pytest.mark.parametrize("potential", POTENTIALS)
def test_dynamical_matrices_are_hermitian_and_those_of_opposite_waves_conjugate(
    potential: Potential,
) -> None:
    wavenumbers = every_wave(potential[0])
    D = matrices_of(potential, wavenumbers)
    assert np.array_equal(D, D.conj().transpose(0, 2, 1))
    assert np.array_equal(matrices_of(potential, -wavenumbers), D.conj())
    assert not D[0].any()
    there = waves_of(potential, wavenumbers)[0]
    back = waves_of(potential, -wavenumbers)[0]
    assert back == pytest.approx(there, rel=1e-13, abs=1e-13)


def test_dynamical_matrix_is_the_sum_over_neighbours() -> None:
    potential = POTENTIALS[4]
    p = np.array([[1, 2], [4, 5], [3, 0]])
    naive = np.zeros((3, 3, 3), dtype=complex)
    for offset, K in all_constants(potential[1]).items():
        phase = 2 * np.pi * (p / potential[0]) @ np.array(offset)
        naive += np.exp(1j * phase)[:, None, None] * K / potential[2]
    D = matrices_of(potential, p)
    assert pytest.approx(naive, abs=1e-13) == D
    assert np.abs(D.imag).max() >= 0.1


def test_diagonal_force_constants_are_the_decoupled_lattice() -> None:
    lattice = Lattice(TORUS, (6, 9), (2.0, 0.3), 0.7)
    modes = lattice.all_modes()
    equal = {(1, 0): -2.0 * np.eye(3), (0, 1): -0.3 * np.eye(3)}
    frequencies, polarisations = polarised_waves((6, 9), equal, modes.wavenumbers, 0.7)
    w = lattice.angular_frequencies(modes)
    for branch in range(3):
        assert frequencies[:, branch] == pytest.approx(w, rel=1e-15, abs=0)
    assert np.array_equal(polarisations, np.broadcast_to(np.eye(3), (54, 3, 3)))
    # Unlike stiffness in x, y, z: three lattices, each direction by itself.
    K = np.array([0.5, 3.0, 1.0])
    unlike = {(1, 0): -np.diag(K), (0, 1): -np.diag(2 * K)}
    frequencies, polarisations = polarised_waves((6, 9), unlike, modes.wavenumbers)
    for direction, (stiffness, branch) in enumerate(zip(K, (0, 2, 1), strict=True)):
        alone = Lattice(TORUS, (6, 9), (stiffness, 2 * stiffness)).angular_frequencies(modes)
        assert frequencies[:, branch] == pytest.approx(alone, rel=2e-15, abs=0)
        assert np.array_equal(polarisations[1:, direction, branch], np.ones(53))


def test_long_waves_on_a_huge_lattice_keep_their_digits() -> None:
    n = 10**8
    w = polarised_waves((n,), {(1,): -np.diag([1.0, 2.0, 3.0])}, np.array([[1]]))[0][0]
    expected = 2 * np.sqrt([1.0, 2.0, 3.0]) * np.sin(np.pi / n)
    assert w == pytest.approx(expected, rel=1e-14, abs=0)
    naive = 2 - 2 * np.cos(2 * np.pi / n)
    assert abs(naive / expected[0] ** 2 - 1) >= 0.01


def test_polarisations_have_a_fixed_phase() -> None:
    for potential in POTENTIALS:
        _, e = waves_of(potential, every_wave(potential[0]))
        size = np.abs(e)
        largest = (size >= size.max(axis=1, keepdims=True) * (1 - 1e-9)).argmax(axis=1)
        entry = np.take_along_axis(e, largest[:, None, :], axis=1)
        assert (entry.real > 0).all()
        assert np.abs(entry.imag).max() <= 1e-15
        assert np.conj(e.transpose(0, 2, 1)) @ e == pytest.approx(
            np.broadcast_to(np.eye(3), e.shape), abs=1e-14
        )
    # Symmetric force constants have real polarisations.
    _, real = waves_of(POTENTIALS[3], every_wave((4, 5)))
    assert np.abs(real.imag).max() <= 1e-14


def test_moving_the_whole_lattice_takes_no_force() -> None:
    for potential in POTENTIALS:
        assert not waves_of(potential, every_wave(potential[0])[:1])[0].any()


@pytest.mark.parametrize(
    "constants",
    [
        {(1,): -np.eye(3), (-1,): -np.eye(3)},
        {(1,): -np.eye(3), (0,): 2 * np.eye(3)},
        {(1,): -np.eye(2)},
        {(1, 0): -np.eye(3)},
        {(1,): np.full((3, 3), np.nan)},
    ],
)
def test_what_is_no_potential_is_refused(constants: Constants) -> None:
    with pytest.raises(ParameterError, match="force constants at offset"):
        dynamical_matrices((5,), constants, np.array([[1]]))


def test_unstable_potentials_are_refused_with_their_wave() -> None:
    # Next neighbours pull apart: long waves would grow, and short ones too.
    with pytest.raises(ParameterError, match=r"\(1,\)") as caught:
        polarised_waves((6,), {(1,): np.diag([-1.0, -1.0, 0.2])}, np.array([[0], [1], [2]]))
    assert caught.value.details["wavenumbers"] == [1]
    with pytest.raises(ParameterError):
        polarised_waves((6,), {(1,): np.diag([-1.0, -1.0, 1e-12])}, np.array([[1]]))
    # A string without tension has no force across it, which is no instability.
    slack = {(1,): -np.outer([1, 2, 2], [1, 2, 2]) / 9}
    w, _ = polarised_waves((6,), slack, every_wave((6,)))
    assert w[:, :2] == pytest.approx(np.zeros((6, 2)), abs=1e-7)
    assert w[:, 2] == pytest.approx(2 * np.sin(np.pi * np.arange(6) / 6), abs=1e-14)


def test_other_wrong_input_is_refused() -> None:
    for mass in (0.0, -1.0, np.nan):
        with pytest.raises(ParameterError, match="mass"):
            dynamical_matrices((4,), {(1,): -np.eye(3)}, np.array([[1]]), mass)
    for n in (0, -4):
        with pytest.raises(ParameterError, match="shape"):
            dynamical_matrices((n,), {(1,): -np.eye(3)}, np.array([[1]]))
    wrong: list[NDArray[Any]] = [np.zeros((3, 2), int), np.zeros((3, 1)), np.zeros(3, int)]
    for wavenumbers in wrong:
        with pytest.raises(ShapeError):
            matrices_of(POTENTIALS[0], wavenumbers)
    for constant, mass in ((1e308, 1.0), (1e299, 1e-10), (1.0, 1e-310), (1e200, 1e-200)):
        K = -constant * np.eye(3)
        with pytest.raises(ParameterError, match="beyond the largest number"):
            polarised_waves((4, 4), {(1, 0): K, (0, 1): K}, np.array([[1, 2]]), mass)
