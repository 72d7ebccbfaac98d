"""Long sequences of large lattices stream: memory does not grow with the number of frames."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest

from modalmotion.modes.lattice import Lattice, project, superpose
from modalmotion.modes.topology import CUP, CYLINDER, TORUS, Topology

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
