"""Sizes that neither overflow nor vanish."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.numeric.products import power_of_two, root_mean_square


@pytest.mark.parametrize("size", [1e-300, 2.0**-1000, 0.3, 1.0, 7.0, 2.0**200, 1e300])
def test_dividing_by_a_power_of_two_costs_no_digit(size: float) -> None:
    scale = power_of_two(size)
    assert np.frexp(scale)[0] == 0.5
    assert size / scale * scale == size
    assert 0.5 <= size / scale < 1.0


def test_nothing_is_not_scaled_and_extremes_stay_in_range() -> None:
    assert power_of_two(0.0) == 1.0
    assert power_of_two(5e-324) == 2.0**-1000
    assert power_of_two(1.7e308) == 2.0**1000


@pytest.mark.parametrize("unit", [1e-300, 1.0, 1e300])
def test_squares_neither_overflow_nor_vanish(unit: float) -> None:
    assert root_mean_square(unit * np.array([3.0, -4.0])) == pytest.approx(unit * np.sqrt(12.5))
    assert root_mean_square(np.zeros(3)) == 0.0
