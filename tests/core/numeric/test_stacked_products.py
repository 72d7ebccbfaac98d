"""The same bits over runs and on any number of threads."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topology import (
    CLOSED_CURVE,
    CUP,
    CYLINDER,
    OPEN_CURVE,
    PLANE,
    SPHERE,
    TORUS,
    Topology,
)
from modalmotion.modes.transform import project, project_all, superpose, superpose_all
from modalmotion.numeric.products import multiply

FloatArray = NDArray[np.float64]


@pytest.fixture(scope="module")
def threads() -> ThreadpoolController:
    """Found once: looking for the libraries takes longer than most products."""
    return ThreadpoolController()


def assert_same_bits(threads: ThreadpoolController, run: Callable[[], FloatArray]) -> None:
    with threads.limit(limits=1):
        first, again = run(), run()
    with threads.limit(limits=2):
        others = [run(), run()]
    for other in (again, *others):
        assert np.array_equal(first, other)


# Every regime of the tiles: vectors and matrices, narrow and wide, short and long sums.
PRODUCTS = [
    (m, k, n)
    for m in (1, 3, 7, 8, 9, 33, 1000)
    for k in (1, 7, 129, 1000, 12_345)
    for n in (1, 3, 63, 3001)
    if m * k <= 200_000 and k * n <= 2_000_000 and m * n <= 500_000
]


@pytest.mark.every(4)
@pytest.mark.parametrize(("m", "k", "n"), PRODUCTS)
def test_products(
    m: int, k: int, n: int, threads: ThreadpoolController, rng: np.random.Generator
) -> None:
    matrix = rng.standard_normal((m, k))
    stack = rng.standard_normal((2, k, n))
    assert_same_bits(threads, lambda: multiply(matrix, stack))
    assert_same_bits(threads, lambda: multiply(np.asfortranarray(matrix), stack))
    exact = matrix @ stack
    assert np.abs(multiply(matrix, stack) - exact).max() <= 1e-14 * k * np.abs(exact).max()


def test_a_stack_does_not_change_its_members(rng: np.random.Generator) -> None:
    for m, k, n in ((3, 40, 300), (9, 400, 1200), (100, 3, 120), (1000, 20, 33)):
        matrix, stack = rng.standard_normal((m, k)), rng.standard_normal((5, k, n))
        together = multiply(matrix, stack)
        for i in range(5):
            assert np.array_equal(multiply(matrix, stack[i : i + 1])[0], together[i])


@pytest.mark.every(4)
@pytest.mark.parametrize(
    ("topology", "shape"),
    [
        (OPEN_CURVE, (40_000,)),
        (CLOSED_CURVE, (12_345,)),
        (PLANE, (400, 401)),
        (CYLINDER, (40, 100)),
        (CYLINDER, (1000, 400)),
        (TORUS, (300, 333)),
        (CUP, (37, 1000)),
        (SPHERE, (513, 128)),
        (Topology.parse("pole-open x closed x open"), (40, 60, 7)),
    ],
    ids=str,
)
@pytest.mark.parametrize("n_modes", [1, 7, 54, pytest.param(300, marks=pytest.mark.soak)])
def test_transforms_and_shapes(
    topology: Topology,
    shape: tuple[int, ...],
    n_modes: int,
    threads: ThreadpoolController,
    rng: np.random.Generator,
) -> None:
    lattice = Lattice(topology, shape)
    modes = lattice.lowest_modes(n_modes)
    u = rng.standard_normal((2, lattice.n_nodes, 3))
    assert_same_bits(threads, lambda: project(lattice, modes, u))
    a = project(lattice, modes, u)
    assert_same_bits(threads, lambda: superpose(lattice, modes, a))
    if n_modes == 7:
        assert_same_bits(threads, lambda: lattice.shapes(modes))
        assert_same_bits(threads, lambda: project_all(lattice, u))
        assert_same_bits(threads, lambda: superpose_all(lattice, u))
