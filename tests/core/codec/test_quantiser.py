"""Steps that are finer than the numbers themselves."""

from __future__ import annotations

import numpy as np
import pytest
from codec_sequences import jointed

from modalmotion.codec import Effort
from modalmotion.codec.frames import choose
from modalmotion.codec.search import ModalBlock, attempt, coarsest
from modalmotion.codec.temporal import MOST_STEPS, Temporal, is_countable, quantise


def test_numbers_are_whole_as_long_as_they_count_as_countable(rng: np.random.Generator) -> None:
    coefficients = rng.normal(size=(4, 5))
    largest = float(np.abs(coefficients).max())
    finest = 1.01 * largest / MOST_STEPS
    assert is_countable(coefficients, finest)
    assert np.abs(quantise(coefficients, finest, 0.0) * finest - coefficients).max() < 2 * finest
    for step in (0.9 * finest, 1e-300, 0.0, float("nan")):
        assert not is_countable(coefficients, step)


@pytest.mark.parametrize("kind", list(Temporal))
def test_a_step_too_fine_for_whole_numbers_is_not_tried(
    kind: Temporal, rng: np.random.Generator
) -> None:
    sequence = jointed(rng)
    offsets = 1e9 * sequence.vertices.transpose(0, 2, 1).astype(np.float64)
    modes = choose(sequence, Effort.BALANCED).modes
    amplitudes = modes.analyse(offsets.reshape(-1, sequence.n_vertices)).reshape(offsets.shape)
    motion = ModalBlock(amplitudes, offsets, modes)
    assert attempt(motion, kind, 1e-12) is None
    # Whatever it is sent after, the search ends with a step that counts, or none.
    trial = coarsest(motion, kind, 1e-30, 1e-3)
    assert trial is None or trial.largest < MOST_STEPS
