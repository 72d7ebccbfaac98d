"""Projection and superposition of some modes, against the shapes themselves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dense_lattices import MIDDLE_LATTICES, SMALL_LATTICES, each_of
from numpy.typing import NDArray

from modalmotion.errors import NonFiniteError, ShapeError, TopologyError
from modalmotion.modes import ModeSet, lowest_modes
from modalmotion.modes.lattice import Lattice, project, superpose
from modalmotion.modes.topologies import CUP, CYLINDER, PLANE, SPHERE, TORUS, Topology

SURFACES = (PLANE, CYLINDER, TORUS, CUP, SPHERE)


def naive_projection(
    lattice: Lattice, modes: ModeSet, displacements: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Phi'u / nodes, every shape at every node."""
    sums: NDArray[np.float64] = np.einsum("nm,fnd->fmd", lattice.shapes(modes), displacements)
    return sums / lattice.n_nodes


@pytest.mark.every(3)
@each_of((*SMALL_LATTICES, *MIDDLE_LATTICES))
def test_both_are_the_products_with_the_shapes(lattice: Lattice, rng: np.random.Generator) -> None:
    for n_modes in {1, max(1, lattice.n_nodes // 2), lattice.n_nodes}:
        modes = lattice.lowest_modes(n_modes)
        u = rng.standard_normal((2, lattice.n_nodes, 3))
        a = project(lattice, modes, u)
        assert np.abs(a - naive_projection(lattice, modes, u)).max() <= 1e-13
        assert np.abs(superpose(lattice, modes, a) - lattice.shapes(modes) @ a).max() <= 1e-13


@pytest.mark.every(5)
@pytest.mark.parametrize("topology", SURFACES, ids=str)
@pytest.mark.parametrize("shape", [(40, 100), (101, 68), (300, 30), (8, 512), (2, 3000)])
@pytest.mark.parametrize("n_modes", [1, 7, 54, 400])
def test_larger_lattices_too(
    topology: Topology, shape: tuple[int, int], n_modes: int, rng: np.random.Generator
) -> None:
    lattice = Lattice(topology, shape)
    modes = lattice.lowest_modes(n_modes)
    u = rng.standard_normal((1, lattice.n_nodes, 2))
    a = project(lattice, modes, u)
    assert np.abs(a - naive_projection(lattice, modes, u)).max() <= 1e-14
    assert np.abs(superpose(lattice, modes, a) - lattice.shapes(modes) @ a).max() <= 1e-12


def scattered_modes(lattice: Lattice, rng: np.random.Generator) -> ModeSet:
    """Some modes, in any order, some of them twice."""
    chosen = rng.integers(0, lattice.n_nodes, max(1, lattice.n_nodes // 3))
    return lattice.all_modes().take(chosen)


@each_of(MIDDLE_LATTICES)
def test_any_modes_in_any_order(lattice: Lattice, rng: np.random.Generator) -> None:
    modes = scattered_modes(lattice, rng)
    u = rng.standard_normal((2, lattice.n_nodes, 1))
    a = project(lattice, modes, u)
    assert np.abs(a - naive_projection(lattice, modes, u)).max() <= 1e-13
    assert np.abs(superpose(lattice, modes, a) - lattice.shapes(modes) @ a).max() <= 1e-12


def test_float32_is_taken_as_it_is(rng: np.random.Generator) -> None:
    lattice = Lattice(CUP, (12, 16))
    modes = lattice.lowest_modes(18)
    u = rng.standard_normal((3, 192, 3)).astype(np.float32)
    a = project(lattice, modes, u)
    assert a.dtype == np.float64
    assert np.array_equal(a, project(lattice, modes, u.astype(np.float64)))
    assert np.array_equal(a, project(lattice, modes, u.astype(">f4")))
    assert np.array_equal(a, project(lattice, modes, np.asfortranarray(u)))
    short = a.astype(np.float32)
    assert np.array_equal(
        superpose(lattice, modes, short), superpose(lattice, modes, short.astype(np.float64))
    )


def test_integers_count_as_numbers() -> None:
    lattice = Lattice(CUP, (2, 4))
    u = np.ones((1, 8, 3), dtype=np.int16)
    a = project(lattice, lattice.lowest_modes(2), u)[0]
    assert a == pytest.approx(np.array([[1.0] * 3, [0.0] * 3]), abs=1e-15)


def test_a_frame_does_not_depend_on_its_company(rng: np.random.Generator) -> None:
    # More frames than fit one block.
    lattice = Lattice(CYLINDER, (64, 80))
    modes = lattice.lowest_modes(54)
    u = rng.standard_normal((150, lattice.n_nodes, 3))
    a = project(lattice, modes, u)
    w = superpose(lattice, modes, a)
    for frame in (0, 1, 67, 68, 69, 149):
        one = slice(frame, frame + 1)
        assert np.array_equal(project(lattice, modes, u[one])[0], a[frame])
        assert np.array_equal(superpose(lattice, modes, a[one])[0], w[frame])


def test_no_frames_have_no_amplitudes() -> None:
    lattice = Lattice(CUP, (3, 4))
    modes = lattice.lowest_modes(4)
    a = project(lattice, modes, np.zeros((0, 12, 3)))
    assert a.shape == (0, 4, 3)
    assert superpose(lattice, modes, a).shape == (0, 12, 3)


def test_a_static_sequence_has_amplitudes_of_exactly_0() -> None:
    lattice = Lattice(CUP, (9, 12))
    assert not project(lattice, lattice.all_modes(), np.zeros((3, 108, 3))).any()


def test_displacements_are_read_from_a_file(tmp_path: Path, rng: np.random.Generator) -> None:
    lattice = Lattice(TORUS, (20, 30))
    modes = lattice.lowest_modes(21)
    u = rng.standard_normal((5, 600, 3)).astype(np.float32)
    np.save(tmp_path / "u.npy", u)
    a = project(lattice, modes, np.load(tmp_path / "u.npy", mmap_mode="r"))
    assert np.array_equal(a, project(lattice, modes, u))


@pytest.mark.parametrize(
    "bad",
    [
        np.zeros((12, 3)),
        np.zeros((2, 11, 3)),
        np.zeros(12),
        np.zeros((2, 12, 3), dtype=complex),
        np.full((2, 12, 3), "x"),
        np.zeros((2, 12, 3), dtype=bool),
    ],
    ids=str,
)
def test_other_arrays_are_refused(bad: NDArray[Any]) -> None:
    lattice = Lattice(CUP, (3, 4))
    with pytest.raises(ShapeError, match="displacements"):
        project(lattice, lattice.lowest_modes(4), bad)
    with pytest.raises(ShapeError, match="amplitudes"):
        superpose(lattice, lattice.all_modes(), bad)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("n_modes", [1, 4])
def test_what_is_not_finite_is_named(value: float, n_modes: int) -> None:
    lattice = Lattice(CUP, (3, 4))
    modes = lattice.all_modes().take(slice(12 - n_modes, 12))
    for node in range(12):
        u = np.zeros((4, 12, 3))
        u[2, node, 1] = value
        with pytest.raises(NonFiniteError, match=f"Frame 2, node {node}") as caught:
            project(lattice, modes, u)
        assert (caught.value.frame, caught.value.vertex) == (2, node)
    a = np.zeros((4, n_modes, 3))
    a[3, -1, 0] = value
    with pytest.raises(NonFiniteError, match=f"Frame 3, mode {n_modes - 1}"):
        superpose(lattice, modes, a)


def test_a_sum_that_overflows_is_named() -> None:
    lattice = Lattice(CUP, (3, 4))
    u = np.zeros((2, 12, 1))
    u[1] = 1.7e308
    with pytest.raises(NonFiniteError, match="too large") as caught:
        project(lattice, lattice.lowest_modes(1), u)
    assert caught.value.frame == 1


def test_modes_of_another_topology_are_refused() -> None:
    with pytest.raises(TopologyError):
        project(Lattice(CYLINDER, (3, 4)), lowest_modes(CUP, 2), np.zeros((1, 12, 3)))
