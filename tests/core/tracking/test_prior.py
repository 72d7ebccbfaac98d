"""The prior: its law, and finding it in amplitudes that follow one."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.modes import lowest_modes
from modalmotion.modes.topologies import CUP
from modalmotion.tracking.noise import Prior, most_likely_prior

LENGTHS = (80.0, 130.0)


def wavenumbers(n: int) -> np.ndarray:
    return lowest_modes(CUP, n).wavenumbers_on(LENGTHS) * float(np.sqrt(np.prod(LENGTHS)))


def test_variance_is_that_of_the_strain_energy_to_a_power() -> None:
    k = wavenumbers(37)
    v = Prior(scale=20.0, power=1.5, drift=3.0).variances(k)
    assert v[0] == 9.0
    assert v[1:] * k[1:] ** 3 == pytest.approx(400.0)


def test_what_lies_beyond_is_the_sum_of_the_law() -> None:
    # Ranks stand for wavenumbers: on a surface the number of modes up to k grows as k^2.
    prior = Prior(scale=20.0, power=2.0, drift=3.0)
    k = wavenumbers(4000)
    v = prior.variances(k)
    for m in (37, 111, 320):
        mean_square, n_values = prior.beyond(k[:m], 2)
        rest = v[m:].sum() + v[-1] * len(k)
        # The count of modes up to k is k^2 but for those at the edge of the lattice.
        assert mean_square == pytest.approx(rest, rel=0.45)
        assert n_values == pytest.approx(rest**2 / (v[m:] ** 2).sum(), rel=0.4)
        assert prior.concentration(2) == pytest.approx(n_values / (mean_square / v[m - 1]))


@pytest.mark.parametrize("power", [1.5, 2.0, 2.5])
def test_the_prior_that_amplitudes_come_from_is_the_most_likely(
    power: float, rng: np.random.Generator
) -> None:
    true, k = Prior(30.0, power, 2.0), wavenumbers(37)
    a = rng.normal(size=(60, 37, 3)) * np.sqrt(true.variances(k))[:, None]
    n = np.full(37, 180.0)
    found = most_likely_prior(k, (a**2).sum(axis=(0, 2)), n, 1e-9)
    assert found.power == pytest.approx(power, abs=0.1)
    assert found.variances(k) == pytest.approx(true.variances(k), rel=0.4)
    assert found.drift == pytest.approx(2.0, rel=0.3)


def test_amplitudes_that_data_did_not_set_have_no_say(rng: np.random.Generator) -> None:
    true, k = Prior(30.0, 2.0, 2.0), wavenumbers(37)
    energies = (rng.normal(size=(180, 37)) ** 2 * true.variances(k)).sum(axis=0)
    n = np.full(37, 180.0)
    # Half of the frames show nothing: their amplitudes are zero, and count as undetermined.
    assert most_likely_prior(k, energies, n, 1e-9).scale > 1.3 * (
        most_likely_prior(k, energies, 2 * n, 1e-9).scale
    )


def test_a_still_surface_has_a_narrow_prior() -> None:
    k = wavenumbers(7)
    found = most_likely_prior(k, np.zeros(7), np.ones(7), 1e-6)
    assert found.scale == found.drift == 1e-6
