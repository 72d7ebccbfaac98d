from __future__ import annotations

import pytest

from modalmotion.errors import TopologyError
from modalmotion.modes.topologies import (
    CLOSED,
    CLOSED_CURVE,
    CUP,
    CYLINDER,
    OPEN,
    OPEN_CURVE,
    PLANE,
    POLE_OPEN,
    POLE_POLE,
    SPHERE,
    TORUS,
    End,
    Topology,
)

NAMED = (OPEN_CURVE, CLOSED_CURVE, PLANE, CYLINDER, TORUS, CUP, SPHERE)


@pytest.mark.parametrize("topology", NAMED, ids=str)
def test_a_name_reads_back_as_its_topology(topology: Topology) -> None:
    assert Topology.parse(topology.name) == topology
    assert Topology.parse(f" {topology.name.upper().replace(' ', '_')} (a note)") == topology


def test_the_ends_read_back_too() -> None:
    volume = Topology((POLE_OPEN, CLOSED, OPEN))
    assert volume.name == "pole-open x closed x open"
    assert Topology.parse(str(volume)) == volume
    assert Topology.parse("pole-pole x closed") == SPHERE


def test_axes_are_counted() -> None:
    assert [t.n_axes for t in NAMED] == [1, 1, 2, 2, 2, 2, 2]
    assert [t.closed_axes for t in NAMED] == [(), (0,), (), (1,), (0, 1), (1,), (1,)]


@pytest.mark.parametrize("ends", [(), (OPEN,) * 4])
def test_one_to_three_axes(ends: tuple[tuple[End, End], ...]) -> None:
    with pytest.raises(TopologyError, match="one to three"):
        Topology(ends)


@pytest.mark.parametrize(
    "mixed", [(End.OPEN, End.CLOSED), (End.OPEN, End.POLE), (End.CLOSED, End.POLE)]
)
def test_ends_that_cannot_meet_are_refused(mixed: tuple[End, End]) -> None:
    with pytest.raises(TopologyError, match="cannot be joined"):
        Topology((mixed, CLOSED))


@pytest.mark.parametrize(
    "ends",
    [(POLE_OPEN,), (POLE_OPEN, OPEN), (CLOSED, POLE_POLE), (POLE_OPEN, POLE_OPEN, CLOSED)],
)
def test_a_pole_needs_a_closed_axis_after_it(ends: tuple[tuple[End, End], ...]) -> None:
    with pytest.raises(TopologyError, match="not closed"):
        Topology(ends)


@pytest.mark.parametrize("text", ["", "klein bottle", "open x", "cup x open", "x" * 1000])
def test_other_words_name_no_topology(text: str) -> None:
    with pytest.raises(TopologyError, match="names no topology") as caught:
        Topology.parse(text)
    assert len(str(caught.value)) <= 400


def test_the_word_mesh_is_told_where_it_belongs() -> None:
    with pytest.raises(TopologyError, match="how a surface is read") as caught:
        Topology.parse("mesh")
    assert "topology=mesh" in caught.value.remedy
