"""Few trials to the error whose stream fills the bytes that it may have."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from codec_sequences import lattice_sequence

from modalmotion.codec import encode, encoder
from modalmotion.codec.search import FULL_ENOUGH, MOST_TRIALS, try_sizes
from modalmotion.mesh.sequence import mesh_sequence

BRACKET = (-23.0, 2.0)
SLOPE = 1000.0


def tried(size: Any, most: int, start: float = -6.0) -> list[tuple[float, int | None]]:
    seen: list[tuple[float, int | None]] = []

    def note(log_error: float) -> int | None:
        seen.append((log_error, size(log_error)))
        return seen[-1][1]

    try_sizes(note, most, BRACKET, start, SLOPE)
    return seen


def straight(log_error: float) -> int:
    """A bit for each coefficient where the error is halved, and none beyond the motion."""
    return round(200 + SLOPE * math.log1p(math.exp(-log_error)))


@pytest.mark.parametrize("most", [400, 1_000, 5_000, 9_000, 20_000])
def test_a_few_trials_find_the_size(most: int) -> None:
    seen = tried(straight, most)
    assert len(seen) <= 7
    n_bytes = seen[-1][1]
    assert n_bytes is not None
    assert FULL_ENOUGH * most < n_bytes <= most


def test_what_is_too_fine_for_a_stream_is_left_soon() -> None:
    seen = tried(lambda at: None if at < -12.3 else straight(at), 1_000_000)
    assert len(seen) <= 12
    finest = min(at for at, n_bytes in seen if n_bytes is not None)
    assert -12.3 <= finest < -12.2


def test_sizes_that_jump_end_the_search_too() -> None:
    seen = tried(lambda at: 100 if at > -3.3 else 10_000, 5_000)
    assert len(seen) <= MOST_TRIALS
    assert min(at for at, n_bytes in seen if n_bytes == 100) < -3.29


@pytest.mark.parametrize("share", [0.2, 0.45])
def test_more_bytes_than_are_needed_cost_no_more_time(
    share: float, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A float64 has room for errors that no coefficient of a mode reaches.
    like = lattice_sequence(rng)
    vertices = like.vertices.astype(np.float64) + rng.normal(0, 1e-9, like.vertices.shape)
    sequence = mesh_sequence(vertices, grid=like.grid, topology=like.topology)
    n_trials = 0

    def counted(*args: Any) -> Any:
        nonlocal n_trials
        n_trials += 1
        return at_error(*args)

    at_error = encoder._at_error
    monkeypatch.setattr(encoder, "_at_error", counted)
    n_bytes = int(share * vertices.nbytes)
    encoded = encode(sequence, n_bytes=n_bytes, effort="fast")
    assert encoded.n_bytes <= n_bytes
    assert encoded.rms < 1e-4
    assert n_trials <= 10
