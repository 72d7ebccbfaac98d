"""The fast transforms of all modes, against the dense shapes."""

from __future__ import annotations

import numpy as np
import pytest
from dense_lattices import MIDDLE_LATTICES, SMALL_LATTICES, SURFACES, each_of
from hypothesis import given
from hypothesis import strategies as st

from modalmotion.errors import NonFiniteError, ShapeError
from modalmotion.modes.lattice import Lattice, project, project_all, superpose, superpose_all
from modalmotion.modes.topologies import CUP, CYLINDER, TORUS, Topology


@pytest.mark.every(3)
@each_of((*SMALL_LATTICES, *MIDDLE_LATTICES))
def test_both_are_the_products_with_the_shapes(lattice: Lattice, rng: np.random.Generator) -> None:
    Phi = lattice.shapes(lattice.all_modes())
    u = rng.standard_normal((2, lattice.n_nodes, 3))
    a = np.einsum("nm,fnd->fmd", Phi, u) / lattice.n_nodes
    assert np.abs(project_all(lattice, u) - a).max() <= 1e-13
    assert np.abs(superpose_all(lattice, a) - u).max() <= 1e-13


@pytest.mark.parametrize("topology", SURFACES, ids=str)
@pytest.mark.parametrize("shape", [(64, 100), (37, 62), (101, 26)])
def test_larger_lattices_through_their_factors(
    topology: Topology, shape: tuple[int, int], rng: np.random.Generator
) -> None:
    lattice = Lattice(topology, shape)
    modes = lattice.all_modes()
    u = rng.standard_normal((1, lattice.n_nodes, 2))
    a = project_all(lattice, u)
    assert np.abs(project(lattice, modes, u) - a).max() <= 1e-14
    assert np.abs(superpose(lattice, modes, a) - u).max() <= 1e-12
    assert np.abs(superpose_all(lattice, a) - u).max() <= 1e-13


@given(
    topology=st.sampled_from(SURFACES),
    shape=st.tuples(st.integers(1, 20), st.integers(1, 10).map(lambda n: 2 * n)),
    seed=st.integers(0, 1000),
)
def test_parseval_and_reconstruction(topology: Topology, shape: tuple[int, int], seed: int) -> None:
    lattice = Lattice(topology, shape)
    u = np.random.default_rng(seed).standard_normal((2, lattice.n_nodes, 3))
    a = project_all(lattice, u)
    assert (a**2).sum(axis=1) == pytest.approx((u**2).mean(axis=1), rel=1e-13)
    assert np.abs(superpose_all(lattice, a) - u).max() <= 1e-13


@pytest.mark.parametrize("topology", SURFACES, ids=str)
def test_one_amplitude_gives_its_shape(topology: Topology) -> None:
    lattice = Lattice(topology, (6, 8))
    one = np.eye(48)[:, :, None]
    shapes = superpose_all(lattice, one)[:, :, 0].T
    assert np.abs(shapes - lattice.shapes(lattice.all_modes())).max() <= 1e-14


def test_the_input_is_left_as_it_was(rng: np.random.Generator) -> None:
    for topology in SURFACES:
        lattice = Lattice(topology, (6, 8))
        u = rng.standard_normal((2, 48, 3))
        kept = u.copy()
        a = project_all(lattice, u)
        assert np.array_equal(u, kept)
        amplitudes = a.copy()
        superpose_all(lattice, a)
        assert np.array_equal(a, amplitudes)


def test_float32_is_taken_as_it_is(rng: np.random.Generator) -> None:
    lattice = Lattice(TORUS, (12, 16))
    u = rng.standard_normal((3, 192, 3)).astype(np.float32)
    a = project_all(lattice, u)
    assert a.dtype == np.float64
    assert np.array_equal(a, project_all(lattice, u.astype(np.float64)))
    assert np.array_equal(a[1], project_all(lattice, u[1:2])[0])


def test_what_does_not_fit_is_refused() -> None:
    lattice = Lattice(CYLINDER, (3, 4))
    with pytest.raises(ShapeError, match="displacements"):
        project_all(lattice, np.zeros((1, 11, 3)))
    with pytest.raises(ShapeError, match="amplitudes"):
        superpose_all(lattice, np.zeros((12, 3)))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_named(value: float) -> None:
    lattice = Lattice(CUP, (3, 4))
    u = np.zeros((3, 12, 3))
    u[2, 7, 1] = value
    with pytest.raises(NonFiniteError, match="Frame 2, node 7") as caught:
        project_all(lattice, u)
    assert (caught.value.frame, caught.value.vertex) == (2, 7)
    with pytest.raises(NonFiniteError, match="Frame 2, mode 7"):
        superpose_all(lattice, u)
