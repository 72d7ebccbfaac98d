"""The chain of time: its precision, and all frames estimated at once as densely."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.tracking.time_chain import chain_precision, joined, most_likely_h0


@pytest.mark.parametrize("is_closed", [True, False])
@pytest.mark.parametrize("n", [1, 2, 3, 5, 12, 25])
def test_variance_is_one_at_each_frame(n: int, is_closed: bool) -> None:
    phases = np.arange(n) / n
    Q = chain_precision(phases, 1.5, is_closed=is_closed)
    assert np.array_equal(Q, Q.T)
    assert np.diag(np.linalg.inv(Q)) == pytest.approx(1.0)
    i, j = np.indices(Q.shape)
    apart = np.abs(i - j)
    apart = np.minimum(apart, n - apart) if is_closed else apart
    assert not Q[apart > 2].any()


def test_harmonics_are_held_down_as_the_law_says() -> None:
    n, h0 = 64, 2.0
    covariance = np.linalg.inv(chain_precision(np.arange(n) / n, h0, is_closed=True))
    power = np.fft.fft(covariance[0]).real
    h = np.arange(6)
    law = (1.0 + (h / h0) ** 2) ** -2.0
    # Between the frames the chain is straight: 4 sin^2 instead of h^2.
    assert power[:6] / power[0] == pytest.approx(law, rel=0.05)


def test_frames_at_unequal_times_are_nearer_where_they_are() -> None:
    phases = np.array([0.0, 0.02, 0.3, 0.6, 0.8])
    R = np.linalg.inv(chain_precision(phases, 1.5, is_closed=True))
    assert R[0, 1] > 0.95
    assert R[0, 1] > R[1, 2]
    assert R[4, 0] > R[2, 0]


@pytest.mark.parametrize("is_closed", [True, False])
@pytest.mark.parametrize("n_frames", [1, 2, 3, 4, 5, 8, 9, 14])
def test_frames_together_are_one_dense_system(
    n_frames: int, is_closed: bool, rng: np.random.Generator
) -> None:
    n = 6
    Q = chain_precision(np.arange(n_frames) / n_frames, 1.2, is_closed=is_closed)
    K = rng.uniform(0.5, 5.0, n)
    J = rng.normal(size=(n_frames, 4, n))
    A = J.transpose(0, 2, 1) @ J
    A[-1] = 0.0  # a missing frame
    b = (A @ rng.normal(size=(n_frames, n, 1)))[:, :, 0]
    H = np.kron(Q, np.diag(K))
    for k in range(n_frames):
        H[k * n : (k + 1) * n, k * n : (k + 1) * n] += A[k]
    a, C = joined(A, b, K, Q)
    dense = np.linalg.inv(H)
    assert a.ravel() == pytest.approx(dense @ b.ravel(), abs=1e-10)
    for k in range(n_frames):
        assert C[k] == pytest.approx(dense[k * n : (k + 1) * n, k * n : (k + 1) * n], abs=1e-10)


@pytest.mark.parametrize("true", [0.8, 2.0])
def test_trajectories_tell_their_harmonic_and_variance(
    true: float, rng: np.random.Generator
) -> None:
    n = 24
    phases = np.arange(n) / n
    root = np.linalg.cholesky(np.linalg.inv(chain_precision(phases, true, is_closed=True)))
    x = 3.0 * root @ rng.normal(size=(n, 200))
    h0, variance = most_likely_h0(x, np.ones(200), phases, is_closed=True, pinned=None)
    assert h0 == pytest.approx(true, rel=0.25)
    assert variance == pytest.approx(9.0, rel=0.25)
    # Known to be zero at frame 5: the others follow.
    x = x - np.linalg.inv(chain_precision(phases, true, is_closed=True))[:, 5:6] * x[5]
    h0, variance = most_likely_h0(x, np.ones(200), phases, is_closed=True, pinned=5)
    assert h0 == pytest.approx(true, rel=0.25)
    assert variance == pytest.approx(9.0, rel=0.3)
