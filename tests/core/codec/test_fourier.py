"""Transforms against those of scipy, and their inverses."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from modalmotion.codec import spatial_modes as lattice_modes
from modalmotion.codec import temporal as fourier
from modalmotion.modes.topologies import CUP


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 8, 13, 30])
@pytest.mark.parametrize("axis", [0, 1, -1])
def test_transforms_are_those_of_scipy(n: int, axis: int, rng: np.random.Generator) -> None:
    shape = [3, 4, 2]
    shape[axis] = n
    x = rng.normal(size=shape)
    kept = x.copy()
    for ours, inverse, name, kind in (
        (fourier.cosines, fourier.from_cosines, "dct", 2),
        (fourier.sines, fourier.from_sines, "dst", 2),
        (fourier.odd_sines, fourier.odd_sines, "dst", 4),
    ):
        theirs = getattr(scipy.fft, name)(x, type=kind, norm="ortho", axis=axis)
        assert np.abs(ours(x, axis) - theirs).max() < 1e-13
        assert np.abs(inverse(theirs, axis) - x).max() < 1e-13
    turned = fourier.turn(x, axis)
    assert abs((turned**2).sum() / (x**2).sum() - 1.0) < 1e-13
    assert np.abs(fourier.turn_back(turned, axis) - x).max() < 1e-13
    assert np.array_equal(x, kept)


def test_rows_of_a_lattice_are_transformed_each_by_itself(
    monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    modes = lattice_modes.LatticeModes(CUP, (6, 8), (1, 1))
    coefficients = rng.standard_normal((7, 30))
    whole = modes.synthesise(coefficients)
    for at_once in (1, 100, 3 * 48):
        monkeypatch.setattr(lattice_modes, "_AT_ONCE", at_once)
        assert (modes.synthesise(coefficients) == whole).all()
