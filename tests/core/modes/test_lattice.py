"""Modes in closed form against the dense eigenproblem, and the laws they obey."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest
from dense_lattices import MIDDLE_LATTICES, SMALL_LATTICES, each_of, stiffness_matrix
from hypothesis import given
from hypothesis import strategies as st

from modalmotion.errors import LimitError, ParameterError, ShapeError, TopologyError
from modalmotion.modes import ModeLabel, ModeSet, lowest_modes
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import (
    CLOSED_CURVE,
    CUP,
    CYLINDER,
    OPEN_CURVE,
    PLANE,
    SPHERE,
    TORUS,
    Topology,
    lattice_coordinates,
)

LATTICES = (*SMALL_LATTICES, *MIDDLE_LATTICES)


@each_of(LATTICES)
def test_all_modes_solve_the_dense_eigenproblem(lattice: Lattice) -> None:
    modes = lattice.all_modes()
    matrix = stiffness_matrix(lattice)
    eigenvalues = np.linalg.eigh(matrix).eigenvalues
    largest = max(eigenvalues[-1], min(lattice.stiffnesses) / lattice.mass)
    Phi, squared = lattice.shapes(modes), lattice.angular_frequencies(modes) ** 2

    assert len(modes) == lattice.n_nodes
    assert np.abs(np.sort(squared) - eigenvalues).max() <= 1e-13 * largest
    assert np.abs(matrix @ Phi - Phi * squared).max() <= 1e-13 * largest
    assert np.abs(Phi.T @ Phi / lattice.n_nodes - np.eye(lattice.n_nodes)).max() <= 1e-13


@each_of(LATTICES)
def test_shapes_at_some_nodes_are_those_rows(lattice: Lattice) -> None:
    modes = lattice.all_modes()
    nodes = np.arange(lattice.n_nodes)[::-2]
    assert np.array_equal(lattice.shapes(modes, nodes=nodes), lattice.shapes(modes)[nodes])


@pytest.mark.parametrize("shape", [(3000,), (70_001,)])
@pytest.mark.parametrize("topology", [OPEN_CURVE, CLOSED_CURVE])
def test_a_look_up_has_the_bits_of_single_evaluations(
    topology: Topology, shape: tuple[int, ...], rng: np.random.Generator
) -> None:
    lattice = Lattice(topology, shape)
    modes = lattice.lowest_modes(41)
    nodes = rng.integers(0, lattice.n_nodes, 500)
    assert np.array_equal(lattice.shapes(modes, nodes=nodes), lattice.shapes(modes)[nodes])


@pytest.mark.parametrize("topology", [CUP, SPHERE, CYLINDER, TORUS, PLANE])
@pytest.mark.parametrize("shape", [(37, 64), (100, 40), (16, 250)])
def test_any_selection_has_the_bits_of_the_whole(
    topology: Topology, shape: tuple[int, int]
) -> None:
    lattice = Lattice(topology, shape)
    modes = lattice.all_modes()
    some = modes.take(slice(3, None, 97))
    nodes = np.arange(0, lattice.n_nodes, 13)
    few = lattice.shapes(some)
    assert np.array_equal(few[nodes], lattice.shapes(some, nodes=nodes))
    assert np.array_equal(few[:, 5], lattice.shapes(some.take([5]))[:, 0])


def test_one_node_rests() -> None:
    for topology, shape in (
        (OPEN_CURVE, (1,)),
        (CLOSED_CURVE, (1,)),
        (CUP, (1, 2)),
        (PLANE, (1, 1)),
    ):
        lattice = Lattice(topology, shape)
        modes = lattice.lowest_modes(1)
        assert lattice.shapes(modes).tolist() == [[1.0]] * lattice.n_nodes
        assert lattice.angular_frequencies(modes).tolist() == [0.0]


def test_a_ring_of_two_nodes_has_two_springs() -> None:
    lattice = Lattice(CLOSED_CURVE, (2,), stiffness=3.0, mass=0.5)
    modes = lattice.all_modes()
    # Two springs: 4 K / M; a single one would give 2 K / M.
    assert lattice.angular_frequencies(modes) ** 2 == pytest.approx([0.0, 24.0], rel=1e-15)
    assert lattice.shapes(modes).tolist() == [[1.0, -1.0], [1.0, 1.0]]


def test_the_papers_formula_for_one_axis() -> None:
    # Eq. 7, written out.
    n = np.arange(1, 8)
    lattice = Lattice(OPEN_CURVE, (7,), stiffness=2.0, mass=3.0)
    modes = lattice.all_modes()
    p = modes.wavenumbers[:, 0]
    assert lattice.angular_frequencies(modes) == pytest.approx(
        np.sqrt(8 / 3) * np.sin(p * np.pi / 14), abs=1e-15
    )
    expected = np.cos(np.outer((2 * n - 1) * np.pi / 14, p)) * np.where(p > 0, np.sqrt(2), 1)
    assert lattice.shapes(modes) == pytest.approx(expected, abs=1e-14)


def test_frequencies_scale_with_stiffness_and_mass() -> None:
    modes = lowest_modes(CUP, 40)
    one = Lattice(CUP, (9, 12)).angular_frequencies(modes)
    assert Lattice(CUP, (9, 12), 4.0, 16.0).angular_frequencies(modes) == pytest.approx(
        one / 2, rel=1e-15
    )


@given(
    shape=st.tuples(st.integers(1, 9), st.integers(1, 9).map(lambda n: 2 * n)),
    topology=st.sampled_from([PLANE, CYLINDER, TORUS, CUP, SPHERE]),
)
def test_shapes_are_the_continuums_at_the_natural_coordinates(
    shape: tuple[int, int], topology: Topology
) -> None:
    lattice = Lattice(topology, shape)
    modes = lattice.lowest_modes(max(1, lattice.n_nodes // 2))
    ratio = lattice.scales(modes) / np.sqrt(2.0) ** modes.n_waves
    expected = modes.shapes_at(lattice_coordinates(lattice.topology, lattice.shape)) * ratio
    assert np.abs(lattice.shapes(modes) - expected).max() <= 1e-13


@pytest.mark.parametrize(
    ("topology", "shape", "wavenumbers", "part"),
    [
        (OPEN_CURVE, (4,), (4,), "cos"),
        (OPEN_CURVE, (4,), (-1,), "cos"),
        (CLOSED_CURVE, (5,), (3,), "cos"),
        (CLOSED_CURVE, (4,), (-2,), "cos"),
        (CYLINDER, (3, 6), (0, 4), "sin"),
        (CUP, (3, 6), (3, 1), "cos"),
    ],
)
def test_beyond_nyquist_is_refused(
    topology: Topology, shape: tuple[int, ...], wavenumbers: tuple[int, ...], part: str
) -> None:
    lattice = Lattice(topology, shape)
    label = ModeLabel(wavenumbers, "sin" if part == "sin" else "cos")
    modes = ModeSet.of(topology, [ModeLabel((0,) * len(shape), "cos"), label])
    for ask in (lattice.shapes, lattice.angular_frequencies):
        with pytest.raises(ParameterError, match="alias") as caught:
            ask(modes)
        assert str(label) in str(caught.value)
        assert {"axis", "least", "most"} <= set(caught.value.details)


@pytest.mark.parametrize("wavenumbers", [(0, 3), (0, 0), (2, 3), (2, 0)])
def test_sines_that_are_zero_are_refused(wavenumbers: tuple[int, int]) -> None:
    lattice = Lattice(TORUS, (4, 6))
    zero = ModeSet.of(TORUS, [ModeLabel(wavenumbers, "sin")])
    with pytest.raises(ParameterError, match="zero"):
        lattice.shapes(zero)


def test_modes_of_another_topology_are_refused() -> None:
    with pytest.raises(TopologyError, match="cup"):
        Lattice(CYLINDER, (4, 4)).shapes(lowest_modes(CUP, 3))


@pytest.mark.parametrize("n", [1, 3, 5, 101])
def test_a_pole_with_an_odd_circle_is_refused(n: int) -> None:
    for topology in (CUP, SPHERE):
        with pytest.raises(ShapeError, match="odd") as caught:
            Lattice(topology, (4, n))
        assert caught.value.details == {"axis": 1, "nodes": n}


@pytest.mark.parametrize("shape", [(), (4,), (4, 4, 4), (0, 4), (4, -2)])
def test_shapes_that_do_not_fit_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ShapeError):
        Lattice(CYLINDER, shape)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf, (1.0,), (1.0, 0.0)])
def test_stiffness_and_mass_must_be_positive(bad: float | tuple[float, ...]) -> None:
    with pytest.raises(ParameterError):
        Lattice(CYLINDER, (4, 4), stiffness=bad)
    if not isinstance(bad, tuple):
        with pytest.raises(ParameterError):
            Lattice(CYLINDER, (4, 4), mass=bad)


@pytest.mark.parametrize("nodes", [[-1], [24], [0, 30], [[0]], [0.5]])
def test_nodes_that_do_not_exist_are_refused(nodes: list[int]) -> None:
    lattice = Lattice(CYLINDER, (4, 6))
    with pytest.raises(ShapeError):
        lattice.shapes(lattice.lowest_modes(2), nodes=nodes)


def test_no_nodes_have_no_values() -> None:
    lattice = Lattice(CYLINDER, (4, 6))
    assert lattice.shapes(lattice.lowest_modes(4), nodes=[]).shape == (0, 4)


def test_the_longest_axis() -> None:
    lattice = Lattice(CUP, (2**56, 2))
    modes = ModeSet.of(CUP, [ModeLabel((2**56 - 1, 1), "cos"), ModeLabel((2**56 - 1, 0), "cos")])
    # h = 2N - 1 and 2N - 2: the last before the end of the zone.
    assert lattice.angular_frequencies(modes) == pytest.approx([np.sqrt(8.0), 2.0], rel=1e-15)
    values = lattice.shapes(modes, nodes=[0, 2**57 - 1])
    assert np.isfinite(values).all()
    assert np.abs(values).max() <= 2.0
    with pytest.raises(LimitError, match=r"2\^56"):
        Lattice(CUP, (2**56 + 1, 2))
    with pytest.raises(LimitError, match="64 bits"):
        Lattice(PLANE, (2**56, 2**8)).shapes(lowest_modes(PLANE, 1), nodes=[0])


@pytest.mark.parametrize("power", [-1000, -600, 600, 1000])
def test_frequencies_are_right_where_stiffness_over_mass_is_no_number(power: int) -> None:
    usual = Lattice(PLANE, (4, 4), stiffness=(1.0, 3.0), mass=0.7)
    modes, scale = usual.all_modes(), 2.0**power
    far = Lattice(PLANE, (4, 4), stiffness=(scale, 3.0 * scale), mass=0.7 / scale)
    expected = usual.angular_frequencies(modes) * scale
    assert (far.angular_frequencies(modes) == expected).all()


def test_frequencies_of_very_different_springs() -> None:
    lattice = Lattice(PLANE, (4, 4), stiffness=(1e-300, 1e300), mass=1e-300)
    found = lattice.angular_frequencies(lattice.all_modes())
    assert np.isfinite(found).all()
    assert found.max() == pytest.approx(2e300 * np.sin(3 * np.pi / 8), rel=1e-14)
    # What the weak springs alone make is far below the last place of the strong ones.
    stiff = Lattice(PLANE, (4, 4), stiffness=1e308)
    assert np.isfinite(stiff.angular_frequencies(stiff.all_modes())).all()


def test_frequencies_beyond_the_largest_number_are_refused() -> None:
    with pytest.raises(ParameterError, match="beyond the largest number"):
        Lattice(PLANE, (4, 4), stiffness=1e308, mass=1e-308)


def test_all_modes_are_found_once_and_end_with_their_lattice() -> None:
    lattice = Lattice(CYLINDER, (40, 50))
    kept = weakref.ref(lattice.all_modes())
    assert lattice.all_modes() is kept()
    del lattice
    gc.collect()
    assert kept() is None
