"""All frames driven to rest: the same end as the solution's, at any step, as proved."""

from __future__ import annotations

import driven_frames as here
import numpy as np
import pytest
from clouds import Floats
from driven_frames import drive_frames

from modalmotion.errors import ToleranceError
from modalmotion.tracking.map_frames import chain_precision, joined

N_FRAMES, N = 4, 9


def system(rng: np.random.Generator) -> tuple[Floats, Floats, Floats, Floats]:
    """Data terms of unlike strength, one of them empty, and a chain."""
    half = rng.normal(size=(N_FRAMES, N, N // 2)) * np.geomspace(0.5, 2, N_FRAMES)[:, None, None]
    half[2] = 0.0
    A = half @ half.transpose(0, 2, 1)
    Q = chain_precision(np.arange(N_FRAMES) / N_FRAMES, 2.0, 0, is_closed=True)
    b = rng.normal(size=(N_FRAMES, N))
    b[2] = 0.0
    half = rng.normal(size=(N, N))
    return A, b, np.diag(rng.uniform(0.5, 5.0, N)) + 0.1 * (half @ half.T), Q


def test_oscillators_rest_where_the_solution_is(rng: np.random.Generator) -> None:
    A, b, K, Q = system(rng)
    solution = joined(A, b, K, Q)[0]
    found = drive_frames(A, b, K, Q, rng.normal(size=(N_FRAMES, N)), None)
    assert np.abs(found.path[-1] - solution).max() <= 1e-6 * np.abs(solution).max()
    assert found.steps[:5] == (0, 1, 2, 4, 8)
    assert len(found.path) == len(found.steps)
    # The second path begins where the first rests.
    assert drive_frames(A, b, K, Q, found.path[-1], None).path[0] == pytest.approx(found.path[-1])


@pytest.mark.parametrize("step", [0.3, 40.0])
def test_any_step_ends_there(
    step: float, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    A, b, K, Q = system(rng)
    monkeypatch.setattr(here, "STEP", step)
    found = drive_frames(A, b, K, Q, np.zeros((N_FRAMES, N)), None)
    solution = joined(A, b, K, Q)[0]
    assert np.abs(found.path[-1] - solution).max() <= 1e-6 * np.abs(solution).max()
    assert np.abs(found.path).max() <= 3.0 * np.abs(solution).max()


def test_no_eigenvalue_exceeds_the_bound(rng: np.random.Generator) -> None:
    for _ in range(3):
        A, b, K, Q = system(rng)
        W = drive_frames(A, b, K, Q, np.zeros((N_FRAMES, N)), None).frequency
        # The frame without data follows the others.
        seen = np.array([0, 1, 3])
        Q = np.linalg.inv(np.linalg.inv(Q)[np.ix_(seen, seen)])
        q, U = np.linalg.eigh(Q)
        H = np.kron(Q, K)
        M = np.zeros_like(H)
        for f, own in enumerate(A[seen]):
            rows = slice(f * N, (f + 1) * N)
            H[rows, rows] += own
            M[rows, rows] = A[seen].mean(axis=0) + q[f] * K
        turn = np.kron(U.T, np.eye(N))
        largest = np.linalg.eigvals(np.linalg.solve(M, turn @ H @ turn.T)).real.max()
        assert largest <= W**2


def test_a_pinned_frame_stays_where_it_is(rng: np.random.Generator) -> None:
    A, b, K, Q = system(rng)
    found = drive_frames(A, b, K, Q, np.zeros((N_FRAMES, N)), 1)
    assert not found.path[:, 1].any()
    held = A.copy()
    held[1] = 1e8 * K
    b[1] = 0.0
    solution = joined(held, b, K, Q)[0]
    assert found.path[-1] == pytest.approx(solution, abs=1e-5 * np.abs(solution).max())


def test_what_does_not_rest_is_said(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(here, "_MOST_STEPS", 3)
    with pytest.raises(ToleranceError, match="after 3 steps"):
        drive_frames(*system(rng), np.zeros((N_FRAMES, N)), None)


def test_every_step_of_the_proof_is_stable() -> None:
    # Both roots of the step's matrix, for every eigenvalue and length.
    x = np.geomspace(1e-4, 1e3, 200)
    e = np.linspace(0.0, 1.0, 101)[1:, None]
    decay = np.exp(-x)
    S, g, B = 1.0 - (1.0 + x) * decay, x * decay, (1.0 - x) * decay
    trace, determinant = 1.0 - e * S + B, B * (1.0 - e * S) + e * g**2
    roots = np.sqrt((trace**2 / 4 - determinant).astype(complex))
    largest = np.maximum(np.abs(trace / 2 + roots), np.abs(trace / 2 - roots))
    assert largest.max() < 1.0
