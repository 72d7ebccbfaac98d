"""Long sequences of large lattices stream: memory does not grow with the number of frames."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest

from modalmotion.modes.lattice import Lattice, project, project_all, superpose, superpose_all
from modalmotion.modes.topologies import CUP, CYLINDER, TORUS, Topology

LIMIT_BYTES = 200e6


def peak_bytes(run: Callable[[], object]) -> int:
    """Most memory at once beyond what there was before."""
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        run()
        return tracemalloc.get_traced_memory()[1] - before
    finally:
        tracemalloc.stop()


# The other ends take the same pieces of memory.
MILLION = [CYLINDER, *(pytest.param(one, marks=pytest.mark.soak) for one in (CUP, TORUS))]


@pytest.mark.parametrize("topology", MILLION, ids=str)
def test_a_million_nodes_few_modes(topology: Topology) -> None:
    lattice = Lattice(topology, (1000, 1000))
    modes = lattice.lowest_modes(7)
    # 25 frames that take the memory of one.
    u = np.broadcast_to(np.ones((1, 10**6, 3), dtype=np.float32), (25, 10**6, 3))
    assert peak_bytes(lambda: project(lattice, modes, u)) <= LIMIT_BYTES
    a = np.zeros((3, 7, 3))
    assert peak_bytes(lambda: superpose(lattice, modes, a)) <= LIMIT_BYTES + 3 * 24e6


@pytest.mark.parametrize("topology", [MILLION[0], MILLION[2]], ids=str)
def test_a_million_nodes_all_modes(topology: Topology) -> None:
    lattice = Lattice(topology, (1000, 1000))
    u = np.broadcast_to(np.ones((1, 10**6, 3), dtype=np.float32), (2, 10**6, 3))
    answers = 2 * 24e6
    # The first call finds the places of all modes too.
    assert peak_bytes(lambda: project_all(lattice, u)) <= LIMIT_BYTES + answers
    a = project_all(lattice, u)
    assert peak_bytes(lambda: superpose_all(lattice, a)) <= LIMIT_BYTES + answers
    assert np.abs(superpose_all(lattice, a) - 1.0).max() <= 1e-14


@pytest.mark.parametrize("transform", [project_all, superpose_all])
def test_more_frames_take_no_more_memory(
    transform: Callable[..., object], rng: np.random.Generator
) -> None:
    lattice = Lattice(CUP, (100, 100))
    frame = rng.standard_normal((1, 10**4, 3))
    # The places of all modes are found once.
    transform(lattice, frame)

    def peak(n_frames: int) -> int:
        u = np.broadcast_to(frame, (n_frames, 10**4, 3))
        # Beside the answer.
        return peak_bytes(lambda: transform(lattice, u)) - 8 * u.size

    assert peak(40) <= 1.1 * peak(2)
