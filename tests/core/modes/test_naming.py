"""Labels as people write them, and which of them are modes."""

from __future__ import annotations

import pytest

from modalmotion.errors import ParameterError
from modalmotion.modes import ModeLabel, lowest_modes
from modalmotion.modes.lattice import modes_named
from modalmotion.modes.topologies import (
    CUP,
    CYLINDER,
    OPEN_CURVE,
    PLANE,
    SPHERE,
    TORUS,
    Topology,
    parse_label,
)

ALL = (OPEN_CURVE, PLANE, CYLINDER, TORUS, CUP, SPHERE, Topology.parse("closed x closed x closed"))


@pytest.mark.parametrize("topology", ALL, ids=str)
def test_every_mode_is_known_by_its_label_as_it_is_printed(topology: Topology) -> None:
    modes = lowest_modes(topology, 60)
    read = [parse_label(str(label)) for label in modes.labels]
    assert tuple(read) == modes.labels
    assert modes_named(topology, read) == modes


@pytest.mark.parametrize("topology", ALL, ids=str)
def test_labels_that_are_no_modes_are_refused(topology: Topology) -> None:
    """Of all small labels those that are accepted are the modes of a lattice below Nyquist."""
    shape = (8,) * topology.n_axes
    known = set(lowest_modes(topology, 8**topology.n_axes, shape).labels)
    span = range(-2, 3)
    p: list[tuple[int, ...]] = [()]
    for _ in shape:
        p = [(*before, k) for before in p for k in span]
    for wavenumbers in p:
        for part in ("cos", "sin"):
            label = parse_label(f"{','.join(map(str, wavenumbers))},{part}")
            if label in known:
                assert modes_named(topology, [label], shape).labels == (label,)
            else:
                with pytest.raises(ParameterError):
                    modes_named(topology, [label], shape)


@pytest.mark.parametrize(
    "text", ["", "cos", "1,1", "1,1,tan", "1;1;cos", "1.5,1,cos", "1,1,1,1,cos"]
)
def test_texts_that_are_no_labels(text: str) -> None:
    with pytest.raises(ParameterError, match=r"1,1,cos"):
        parse_label(text)


def test_the_label_that_is_meant_is_named() -> None:
    with pytest.raises(ParameterError, match=r"\(1, 1, sin\)"):
        modes_named(CYLINDER, [ModeLabel((1, -1), "sin")])
    with pytest.raises(ParameterError, match="2 axes"):
        modes_named(CYLINDER, [ModeLabel((1,), "cos")])
