"""A motion in a few numbers, for few cases: which modes, how directed, when."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.columns import Column
from modalmotion.classification.features.invariants import Waves, signed_root, sizes


def summary(motion: NDArray[np.complex128], waves: Waves, *, is_cycle: bool) -> NDArray[np.float64]:
    """Values of the columns of `summary_columns`, (features,) float64; see `invariants`."""
    squares, spread = sizes(motion, waves, is_cycle=is_cycle)
    # Over terms, or over everything else.
    by_wave, by_term = np.add.reduce(squares), np.add.reduce(squares, axis=1)
    parts = [np.sqrt(by_wave), np.sqrt(by_term), spread]
    if not is_cycle:
        # The start of a course is known, so the signs of its terms to each other say when.
        flat = motion.real.reshape(len(motion), -1)
        parts.append(signed_root((flat @ flat.T)[_pairs_of_terms(len(motion))]))
    return np.concatenate(parts)


@lru_cache(maxsize=32)
def _pairs_of_terms(n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    i, j = np.triu_indices(n, 1)
    return i, j


def summary_columns(
    waves: Waves, n_terms: int, n_directions: int, *, is_cycle: bool
) -> tuple[Column, ...]:
    """Columns of the values of `summary`."""
    everything = waves.all_modes
    term = "harmonic" if is_cycle else "term"
    columns = [Column(f"size {name}", waves.modes(k)) for k, name in enumerate(waves.names)]
    columns += [Column(f"size {term} {h}", everything) for h in range(1, n_terms + 1)]
    columns += [Column(f"spread {axis}", everything) for axis in range(1, n_directions + 1)]
    if not is_cycle:
        pairs = zip(*np.triu_indices(n_terms, 1), strict=True)
        columns += [Column(f"term {i + 1} with {j + 1}", everything) for i, j in pairs]
    return tuple(columns)
