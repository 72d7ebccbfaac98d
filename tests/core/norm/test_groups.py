"""Names of groups of features."""

from __future__ import annotations

import pytest

from modalmotion.norm.deviations import group_of, groups_of


@pytest.mark.parametrize(
    ("column", "group"),
    [
        ("radial 0 cos 1", "contraction"),
        ("turning 1 sin 2", "twist"),
        ("axial 1 cos 1", "shortening"),
        ("across 2 cos 1", "bending"),
        ("tilt 0 sin 1", "bending"),
        ("oval 1 cos 1", "oval shape"),
        ("side 1", "one side against the other"),
        ("size (1, 0) term 2", "wave (1, 0)"),
        ("together (0, 0) (1, 0)", "how the waves go together"),
        ("spread 1", "how the waves go together"),
        ("log motion", "amount of motion"),
    ],
)
def test_a_column_belongs_to_a_group(column: str, group: str) -> None:
    assert group_of(column) == group


def test_groups_keep_the_order_of_the_columns() -> None:
    assert groups_of(["axial 1", "radial 0", "axial 2"]) == {
        "shortening": [0, 2],
        "contraction": [1],
    }
