"""Every row of the numerical extremes, by its name: the error reached stays within its bound."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import extremes_lattice_rows
import extremes_oscillator_rows
import pytest

LATTICE_ROWS = extremes_lattice_rows.ROWS
ROWS: list[tuple[Any, ...]] = [*LATTICE_ROWS, *extremes_oscillator_rows.ROWS]
WITH_NAIVE = [row for row in LATTICE_ROWS if row[4] is not None]


@pytest.mark.parametrize("row", ROWS, ids=[row[0] for row in ROWS])
def test_row(row: tuple[Any, ...]) -> None:
    _, _, reached, bound, *_ = row
    assert reached() <= bound


@pytest.mark.parametrize(
    ("naive", "bound"), [row[4:2:-1] for row in WITH_NAIVE], ids=[row[0] for row in WITH_NAIVE]
)
def test_the_straightforward_formula_fails(naive: Callable[[], float], bound: float) -> None:
    # Else the row would not be one.
    lost = naive()
    assert math.isnan(lost) or lost > bound


def test_rows_have_names_of_their_own() -> None:
    names = [row[0] for row in ROWS]
    assert len(set(names)) == len(names)
