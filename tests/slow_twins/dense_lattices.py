"""Slow, naive twins: the matrix of a lattice spring by spring, and lattices to compare."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from itertools import product
from typing import Final

import numpy as np
import pytest
from numpy.typing import NDArray

from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import (
    CLOSED,
    CLOSED_CURVE,
    CUP,
    CYLINDER,
    OPEN_CURVE,
    PLANE,
    SPHERE,
    TORUS,
    End,
    Topology,
)

VOLUMES: Final = tuple(
    Topology.parse(text)
    for text in (
        "open x open x open",
        "closed x closed x closed",
        "open x closed x open",
        "closed x open x closed",
        "pole-open x closed x open",
        "pole-open x closed x closed",
        "pole-pole x closed x open",
        "pole-pole x closed x closed",
        "open x pole-open x closed",
        "closed x pole-pole x closed",
    )
)
"""One of each kind of product of three axes."""

SURFACES: Final = (PLANE, CYLINDER, TORUS, CUP, SPHERE)


def fits(topology: Topology, shape: tuple[int, ...]) -> bool:
    """Whether every closed axis around a pole has an even number of nodes."""
    return not any(
        End.POLE in ends and shape[axis + 1] % 2 for axis, ends in enumerate(topology.ends)
    )


SMALL_LATTICES: Final = tuple(
    Lattice(topology, shape)
    for topologies, shapes in (
        ((OPEN_CURVE, CLOSED_CURVE), [(n,) for n in (1, 2, 3, 4, 5, 8, 9)]),
        (SURFACES, list(product((1, 2, 3, 4, 5, 6), (1, 2, 3, 4, 6)))),
        (VOLUMES, [(1, 2, 1), (2, 2, 3), (3, 4, 2), (4, 2, 4), (3, 4, 4), (2, 3, 4), (1, 6, 2)]),
    )
    for topology in topologies
    for shape in shapes
    if fits(topology, shape)
)
"""Lattices of every topology with sizes 1, 2, odd and even."""

MIDDLE_LATTICES: Final = (
    *(Lattice(topology, shape) for topology in SURFACES for shape in ((5, 6), (12, 16), (7, 10))),
    *(Lattice(topology, (9, 14), stiffness=(2.5, 0.3), mass=1.7) for topology in SURFACES),
    *(
        Lattice(topology, (3, 4, 6), stiffness=(1.0, 7.0, 0.2), mass=0.4)
        for topology in VOLUMES
        if fits(topology, (3, 4, 6))
    ),
)
"""Larger ones, and some with a stiffness of its own along each axis."""


def name_of(lattice: Lattice) -> str:
    """Name a lattice in the list of tests."""
    K = "" if len(set(lattice.stiffnesses)) == 1 else f" K={lattice.stiffnesses}"
    return f"{lattice.topology} {'x'.join(map(str, lattice.shape))}{K}"


def each_of(
    lattices: Iterable[Lattice],
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Run a test for each lattice, those of one topology as one test: they are hundreds."""
    groups: dict[str, list[Lattice]] = {}
    for lattice in lattices:
        groups.setdefault(str(lattice.topology), []).append(lattice)

    def decorated(test: Callable[..., None]) -> Callable[..., None]:
        def each(group: list[Lattice], **fixtures: object) -> None:
            for lattice in group:
                try:
                    test(lattice=lattice, **fixtures)
                except BaseException as error:
                    error.add_note(name_of(lattice))
                    raise

        parameters = inspect.signature(test).parameters.values()
        asked = [one.replace(name="group") if one.name == "lattice" else one for one in parameters]
        each.__name__ = test.__name__
        each.__signature__ = inspect.Signature(asked)  # type: ignore[attr-defined]
        return pytest.mark.parametrize("group", groups.values(), ids=list(groups))(each)

    return decorated


def stiffness_matrix(lattice: Lattice) -> NDArray[np.float64]:
    """Assemble the springs one by one, divided by the mass of a node.

    A closed axis joins its last node to its first, so that two nodes get two springs and one
    node gets a spring to itself, which does nothing. A pole joins each node of the row beside
    it to the node half a turn away.

    Returns
    -------
    (nodes, nodes) float64
    """
    matrix = np.zeros((lattice.n_nodes, lattice.n_nodes))
    node = np.arange(lattice.n_nodes).reshape(lattice.shape)

    def join(some: NDArray[np.int64], others: NDArray[np.int64], K: float) -> None:
        for i, j in zip(some.ravel(), others.ravel(), strict=True):
            matrix[i, i] += K
            matrix[j, j] += K
            matrix[i, j] -= K
            matrix[j, i] -= K

    for axis, (ends, n, K) in enumerate(
        zip(lattice.topology.ends, lattice.shape, lattice.stiffnesses, strict=True)
    ):
        rows = [np.take(node, i, axis=axis) for i in range(n)]
        for i in range(n - 1):
            join(rows[i], rows[i + 1], K)
        if ends == CLOSED:
            join(rows[-1], rows[0], K)
        for end, row in ((ends[0], rows[0]), (ends[1], rows[-1])):
            if end == End.POLE:
                # Without its own axis, the closed one stands where the pole's stood.
                half = lattice.shape[axis + 1] // 2
                near, far = np.split(row, [half], axis=axis)
                join(near, far, K)
    return matrix / lattice.mass
