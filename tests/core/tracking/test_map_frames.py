"""The chain of time: its precision, and all frames estimated at once as densely."""

from __future__ import annotations

import numpy as np
import pytest
from clouds import Floats

from modalmotion.tracking.map_frames import chain_precision, joined


def inverse(matrix: Floats) -> Floats:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


@pytest.mark.parametrize("is_closed", [True, False])
@pytest.mark.parametrize("n", [1, 2, 3, 5, 12, 25])
def test_all_frames_share_what_the_anchor_is_off(n: int, is_closed: bool) -> None:
    anchor, offset = n // 3, 0.3
    Q = chain_precision(np.arange(n) / n, 1.5, anchor, offset, is_closed=is_closed)
    assert np.array_equal(Q, Q.T)
    C = inverse(Q)
    assert C[anchor] == pytest.approx(offset)
    others = np.delete(np.diag(C), anchor) - offset
    assert n == 1 or others.mean() == pytest.approx(1.0)
    i, j = np.indices(Q.shape)
    apart = np.abs(i - j)
    apart = np.minimum(apart, n - apart) if is_closed else apart
    assert not Q[apart > 2].any()


def test_harmonics_are_held_down_as_the_law_says() -> None:
    n, h0 = 64, 2.0
    Q = chain_precision(np.arange(n) / n, h0, 0, 1e9, is_closed=True)
    t = 2.0 * np.pi * np.arange(n) / n
    stiffness = np.array([np.cos(h * t) @ Q @ np.cos(h * t) for h in range(1, 6)])
    h = np.arange(1, 6)
    law = (1.0 + (h / h0) ** 2) ** 2 - 1.0
    # Between the frames the chain is straight: 4 sin^2 instead of h^2.
    assert stiffness / stiffness[0] == pytest.approx(law / law[0], rel=0.05)
    assert abs(np.ones(n) @ Q @ np.ones(n)) < 1e-6 * stiffness[0]


def test_frames_at_unequal_times_are_nearer_where_they_are() -> None:
    phases = np.array([0.0, 0.02, 0.3, 0.6, 0.8])
    C = inverse(chain_precision(phases, 1.5, 3, is_closed=True))

    def apart(i: int, j: int) -> float:
        return float(C[i, i] + C[j, j] - 2.0 * C[i, j])

    assert apart(0, 1) < 0.05
    assert apart(0, 1) < apart(1, 2)
    assert apart(4, 0) < apart(2, 0)


@pytest.mark.parametrize("is_closed", [True, False])
@pytest.mark.parametrize("n_frames", [1, 2, 3, 4, 5, 8, 9, 14])
def test_frames_together_are_one_dense_system(
    n_frames: int, is_closed: bool, rng: np.random.Generator
) -> None:
    n = 6
    Q = chain_precision(np.arange(n_frames) / n_frames, 1.2, 0, is_closed=is_closed)
    K = np.diag(rng.uniform(0.5, 5.0, n)) + 0.1
    J = rng.normal(size=(n_frames, 4, n))
    A = J.transpose(0, 2, 1) @ J
    A[-1] = 0.0  # a missing frame
    b = (A @ rng.normal(size=(n_frames, n, 1)))[:, :, 0]
    H = np.kron(Q, K)
    for k in range(n_frames):
        H[k * n : (k + 1) * n, k * n : (k + 1) * n] += A[k]
    a, C = joined(A, b, K, Q)
    dense = np.linalg.inv(H)
    assert a.ravel() == pytest.approx(dense @ b.ravel(), abs=1e-10)
    for k in range(n_frames):
        assert C[k] == pytest.approx(dense[k * n : (k + 1) * n, k * n : (k + 1) * n], abs=1e-10)
