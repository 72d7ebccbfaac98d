"""The fixed order of modes: labels first, and never an eigenvalue."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from itertools import pairwise, product

import numpy as np
import pytest
from dense_lattices import SMALL_LATTICES, SURFACES, VOLUMES, each_of, fits
from hypothesis import given
from hypothesis import strategies as st

from modalmotion.errors import LimitError, ModeCountError
from modalmotion.mesh.spring_modes import common_count
from modalmotion.modes import ModeLabel, all_modes, lowest_modes, whole_count
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.mode_set import squared_keys
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

TOPOLOGIES = (OPEN_CURVE, CLOSED_CURVE, *SURFACES, *VOLUMES)


def naive_labels(topology: Topology, shape: tuple[int, ...]) -> Iterator[ModeLabel]:
    """All labels of a lattice, wave vector by wave vector, each opposite pair once."""
    seen = set()
    for p in product(*(range(-n, n + 1) for n in shape)):
        inside = all(
            -n < 2 * q <= n if ends == CLOSED else 0 <= q < n
            for ends, n, q in zip(topology.ends, shape, p, strict=True)
        )
        if not inside:
            continue
        opposite = tuple(
            -q if ends == CLOSED and 2 * q != n else q
            for ends, n, q in zip(topology.ends, shape, p, strict=True)
        )
        if opposite in seen:
            continue
        seen.add(p)
        yield ModeLabel(max(p, opposite), "cos")
        if p != opposite:
            yield ModeLabel(max(p, opposite), "sin")


def naive_key(topology: Topology, label: ModeLabel) -> Fraction:
    """Squared wavenumber / pi^2 on the reference surface, in fractions."""
    lengths = (Fraction(11, 20), Fraction(1), Fraction(1, 10))
    k_squared = Fraction(0)
    for axis, (ends, p) in enumerate(zip(topology.ends, label.wavenumbers, strict=True)):
        if ends == CLOSED:
            waves = Fraction(2 * p)
        elif End.POLE in ends and label.wavenumbers[axis + 1] % 2:
            waves = p + (Fraction(1) if ends[1] == End.POLE else Fraction(1, 2))
        else:
            waves = Fraction(p)
        k_squared += (waves / lengths[axis]) ** 2
    return k_squared


@each_of(SMALL_LATTICES)
def test_all_modes_are_the_naive_ones_by_wavenumber(lattice: Lattice) -> None:
    labels = lattice.all_modes().labels
    assert len(labels) == lattice.n_nodes
    assert set(labels) == set(naive_labels(lattice.topology, lattice.shape))
    keys = [naive_key(lattice.topology, label) for label in labels]
    assert keys == sorted(keys)


@pytest.mark.parametrize("topology", TOPOLOGIES, ids=str)
def test_fewer_modes_are_the_first_of_more(topology: Topology) -> None:
    most = lowest_modes(topology, 300)
    for n in (1, 2, 3, 7, 54, 99, 100, 101, 299):
        assert lowest_modes(topology, n) == most.take(slice(0, n))


@pytest.mark.parametrize("topology", TOPOLOGIES, ids=str)
def test_the_order_does_not_depend_on_the_number_of_nodes(topology: Topology) -> None:
    n_axes = topology.n_axes
    everywhere = lowest_modes(topology, 30)
    for shape in ((64,) * n_axes, (80, 66, 70)[:n_axes], (1000,) * n_axes):
        assert lowest_modes(topology, 30, shape) == everywhere
    # Of fewer nodes those that exist, in the same order.
    small = (6, 4, 2)[:n_axes]
    exist = set(all_modes(topology, small).labels)
    common = [label for label in lowest_modes(topology, 5000).labels if label in exist]
    assert [x for x in all_modes(topology, small).labels if x in set(common)] == common


@pytest.mark.parametrize("topology", TOPOLOGIES, ids=str)
def test_a_cosine_is_followed_by_its_sine(topology: Topology) -> None:
    labels = lowest_modes(topology, 500).labels
    for before, label in pairwise(labels):
        if label.part == "sin":
            assert before == ModeLabel(label.wavenumbers, "cos")


WHOLE = {
    CYLINDER: [1, 2, 4, 6, 7, 18, 37],
    CUP: [1, 2, 4, 6, 7, 18, 37],
    SPHERE: [1, 2, 4, 5, 7],
    TORUS: [1, 3, 5, 7],
    CLOSED_CURVE: [1, 3, 5, 7],
    PLANE: list(range(1, 41)),
    OPEN_CURVE: list(range(1, 41)),
}


@pytest.mark.parametrize(("topology", "whole"), WHOLE.items(), ids=str)
def test_whole_sets(topology: Topology, whole: list[int]) -> None:
    found = [n for n in range(1, 41) if whole_count(topology, n) == n]
    assert set(whole) <= set(found)
    # Up to seven the list is complete.
    assert [n for n in found if n <= 7] == [n for n in whole if n <= 7]
    assert 7 in found


def test_a_count_that_splits_a_pair_is_rounded_up() -> None:
    assert whole_count(CUP, 3) == 4
    assert whole_count(CUP, 17) == 18
    assert whole_count(CYLINDER, 3, (2, 3)) == 4
    assert Lattice(CYLINDER, (2, 3)).whole_modes(3).labels[-1] == ModeLabel((0, 1), "sin")


@pytest.mark.every(4)
@each_of(SMALL_LATTICES)
def test_a_whole_set_holds_both_of_every_pair(lattice: Lattice) -> None:
    every = set(lattice.all_modes().labels)
    for n in range(1, lattice.n_nodes + 1):
        labels = set(lattice.whole_modes(n).labels)
        assert n <= len(labels) <= n + 1
        for label in labels:
            partner = ModeLabel(label.wavenumbers, "sin" if label.part == "cos" else "cos")
            assert partner in labels or partner not in every


@pytest.mark.every(5)
@pytest.mark.parametrize("n", range(1, 9))
@pytest.mark.parametrize("m", range(1, 9))
def test_self_conjugate_points_of_the_torus(n: int, m: int) -> None:
    modes = all_modes(TORUS, (n, m))
    alone = set(modes.labels) - {
        ModeLabel(label.wavenumbers, part)
        for label in modes.labels
        if label.part == "sin"
        for part in ("cos", "sin")
    }
    assert len(modes) == n * m
    assert len(alone) == (2 - n % 2) * (2 - m % 2)


def test_degenerate_modes_keep_their_places_by_label() -> None:
    # On a torus whose frequencies coincide eightfold, and on a square plane.
    labels = [label.wavenumbers for label in all_modes(TORUS, (8, 8)).labels]
    assert labels == [label.wavenumbers for label in all_modes(TORUS, (8, 8)).labels]
    first = [x for x in lowest_modes(TORUS, 60).labels if set(map(abs, x.wavenumbers)) == {1, 2}]
    assert [str(x) for x in first] == [
        "(1, 2, cos)",
        "(1, 2, sin)",
        "(1, -2, cos)",
        "(1, -2, sin)",
        "(2, 1, cos)",
        "(2, 1, sin)",
        "(2, -1, cos)",
        "(2, -1, sin)",
    ]


def test_wave_vectors_of_equal_length_come_by_their_first_wavenumber() -> None:
    # 11 / 0.55 = 20 / 1: the same wavenumber on the reference surface.
    labels = [label.wavenumbers for label in lowest_modes(PLANE, 400).labels]
    assert labels.index((0, 20)) + 1 == labels.index((11, 0))
    labels = [label.wavenumbers for label in lowest_modes(TORUS, 4000).labels]
    ring = [p for p in labels if p[0] ** 2 * 400 + p[1] ** 2 * 121 == 121 * 400]
    assert ring == [(0, 20), (0, 20), (11, 0), (11, 0)]


@pytest.mark.parametrize("topology", TOPOLOGIES, ids=str)
def test_integer_keys_are_the_wavenumbers_on_the_reference_surface(topology: Topology) -> None:
    modes = lowest_modes(topology, 400)
    k = modes.wavenumbers_on((0.55, 1.0, 0.1)[: topology.n_axes])
    key = squared_keys(topology, modes.wavenumbers)
    assert np.sqrt(key * np.pi**2 / 484) == pytest.approx(k, rel=1e-14)
    assert (np.diff(k) >= -1e-12 * k[1:]).all()


@given(n=st.integers(-5, 0))
def test_no_modes_are_refused(n: int) -> None:
    with pytest.raises(ModeCountError):
        lowest_modes(CUP, n)


def test_more_modes_than_there_are_are_refused() -> None:
    with pytest.raises(ModeCountError, match="1 to 24") as caught:
        lowest_modes(CYLINDER, 25, (4, 6))
    assert caught.value.details == {"modes": 25, "most": 24}
    with pytest.raises(ModeCountError, match="1 to 10000000"):
        lowest_modes(CYLINDER, 10_000_001)
    with pytest.raises(ModeCountError, match="1 to 10000000"):
        all_modes(CYLINDER, (10_000, 10_000))


def test_few_modes_of_a_huge_lattice_are_found_without_the_others() -> None:
    shape = (10**16, 10**12)
    assert lowest_modes(CUP, 54, shape) == lowest_modes(CUP, 54)


def test_wavenumbers_too_large_to_square_are_refused() -> None:
    with pytest.raises(LimitError, match="64 bits"):
        squared_keys(OPEN_CURVE, np.array([[2**31]]))
    assert squared_keys(OPEN_CURVE, np.array([[2**26]]))[0] == 400 * 2**54


def test_every_topology_is_listed_with_a_shape_that_fits() -> None:
    assert all(fits(topology, (2, 2, 2)[: topology.n_axes]) for topology in TOPOLOGIES)


@pytest.mark.parametrize("topology", [CUP, CYLINDER, SPHERE, TORUS, PLANE])
def test_a_lattice_of_few_nodes_has_the_first_modes_and_then_others(topology: Topology) -> None:
    fine, coarse = lowest_modes(topology, 16, (32, 64)), lowest_modes(topology, 16, (4, 4))
    assert common_count(fine) == 16
    n = common_count(coarse)
    assert 3 <= n < 16
    assert coarse.labels[:n] == fine.labels[:n]
    assert coarse.labels[: n + 2] != fine.labels[: n + 2]
    # Pairs are whole.
    assert whole_count(topology, n) == n
