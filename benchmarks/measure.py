"""Timing side by side, and tables of what was measured."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

USUAL_SECONDS: Final = 2.3e-3
"""Of the fixed piece of NumPy work, on a core of 2024."""

# Long enough for the clock, short enough that what runs side by side meets the same machine.
_SHORTEST_SAMPLE_SECONDS = 1e-3


@dataclass(frozen=True)
class Times:
    """Seconds a call, one number for each sample."""

    samples: tuple[float, ...]

    @property
    def best(self) -> float:
        """Fastest sample."""
        return min(self.samples)

    @property
    def median(self) -> float:
        """Middle sample."""
        return statistics.median(self.samples)


def table(title: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Lay figures out in Markdown."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join([f"*{title}.*", "", *("| " + " | ".join(line) + " |" for line in lines)])


def side_by_side(
    calls: Mapping[str, Callable[[], object]],
    n_samples: int = 30,
    clock: Callable[[], float] = time.perf_counter,
    sample_seconds: float = _SHORTEST_SAMPLE_SECONDS,
) -> dict[str, Times]:
    """Time calls in turn, again and again, so that each meets the same machine.

    Parameters
    ----------
    calls : mapping of name to call
    n_samples : int
        How many times each is measured; a short call is repeated within a sample.
    clock : callable
        Gives seconds; `time.process_time` where the machine is shared.
    sample_seconds : float
        Least length of a sample. The first call of each meets memory that the calls beside it
        have filled: longer samples are of calls one after another.
    """
    repeats = {name: _repeats(call, sample_seconds) for name, call in calls.items()}
    samples: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(n_samples):
        for name, call in calls.items():
            start = clock()
            for _ in range(repeats[name]):
                call()
            samples[name].append((clock() - start) / repeats[name])
    return {name: Times(tuple(seconds)) for name, seconds in samples.items()}


def beside_numpy(calls: Mapping[str, Callable[[], object]], n_samples: int = 9) -> dict[str, float]:
    """Processor time of calls over that of a fixed piece of NumPy work, taken in turn.

    Both meet the same machine, so the ratio says little of how busy it is. Medians of samples.
    """
    times = side_by_side({"": fixed_work, **calls}, n_samples, time.process_time, 0.02)
    ratios = {
        name: [a / b for a, b in zip(times[name].samples, times[""].samples, strict=True)]
        for name in calls
    }
    return {name: statistics.median(of_call) for name, of_call in ratios.items()}


def fixed_work() -> None:
    """Decompose, sort and exponentiate the same numbers with NumPy."""
    matrix, values = _numbers()
    np.linalg.qr(matrix)
    np.sort(values)
    np.exp(values)


@cache
def _numbers() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rng = np.random.default_rng(0)
    return rng.standard_normal((1000, 60)), rng.standard_normal(100_000)


def of_usual_core(seconds: float) -> float:
    """Processor time as it were on a core that does the fixed work in 2.3 ms."""
    work = side_by_side({"": fixed_work}, 9, time.process_time, 0.02)[""].median
    return seconds * USUAL_SECONDS / work


def in_words(seconds: float) -> str:
    """Write a duration with three digits and its unit."""
    for factor, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "us")):
        if seconds * factor >= 1 or unit == "us":
            return f"{seconds * factor:.3g} {unit}"
    return ""


def _repeats(call: Callable[[], object], sample_seconds: float) -> int:
    call()
    start = time.perf_counter()
    call()
    return max(1, int(sample_seconds / max(1e-9, time.perf_counter() - start)))
