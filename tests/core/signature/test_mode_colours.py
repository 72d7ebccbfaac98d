"""Colours of modes: of the label alone, and told apart without seeing colours."""

from __future__ import annotations

from itertools import combinations

import pytest

from modalmotion.modes import lowest_modes
from modalmotion.modes.topologies import CLOSED_CURVE, CUP, PLANE, SPHERE, Topology
from modalmotion.signature.mode_names import DASHES, mode_colour, mode_dash, mode_tone


@pytest.mark.parametrize("topology", [CLOSED_CURVE, CUP, PLANE, SPHERE])
def test_a_colour_and_dash_belong_to_a_wave_and_to_no_other_beside_it(topology: Topology) -> None:
    looks: dict[tuple[int, ...], tuple[str, tuple[float, ...]]] = {}
    for label in lowest_modes(topology, 40).labels:
        look = mode_colour(label), mode_dash(label)
        # A cosine and its sine are one wave.
        assert looks.setdefault(label.wavenumbers, look) == look
    for (one, a), (other, b) in combinations(list(looks.items())[:12], 2):
        assert a != b, (one, other)
    # The first six differ in the dash: no colour has to be seen.
    assert len({dash for _, dash in list(looks.values())[:5]}) == 5
    assert len(set(DASHES)) == len(DASHES)


def test_labels_are_numbered_without_a_gap() -> None:
    labels = [label for label in lowest_modes(PLANE, 200).labels if sum(label.wavenumbers) < 8]
    assert sorted(map(mode_tone, labels)) == list(range(36))
