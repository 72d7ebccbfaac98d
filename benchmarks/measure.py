"""Timing side by side, and tables of what was measured."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Calls = Mapping[str, Callable[[], object]]

USUAL_SECONDS: Final = 2.3e-3  # of the fixed piece of NumPy work, on a core of 2024


def table(title: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Lay figures out in Markdown."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join([f"*{title}.*", "", *("| " + " | ".join(line) + " |" for line in lines)])


def side_by_side(calls: Calls, n_samples: int) -> dict[str, Floats]:
    """Time calls in turn, again and again: of each (n_samples,) processor seconds."""
    repeats = {name: _repeats(call) for name, call in calls.items()}
    samples: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(n_samples):
        for name, call in calls.items():
            start = time.process_time()
            for _ in range(repeats[name]):
                call()
            samples[name].append((time.process_time() - start) / repeats[name])
    return {name: np.array(seconds) for name, seconds in samples.items()}


def medians(calls: Calls, n_samples: int) -> list[float]:
    """Processor seconds of calls, side by side."""
    return [float(np.median(seconds)) for seconds in side_by_side(calls, n_samples).values()]


def beside_numpy(calls: Calls, n_samples: int = 9) -> dict[str, float]:
    """Processor time of calls over that of a fixed piece of NumPy work, medians of samples.

    Both meet the same machine, so the ratio says little of how busy it is.
    """
    work, *times = side_by_side({"": fixed_work, **calls}, n_samples).values()
    return {name: float(np.median(t / work)) for name, t in zip(calls, times, strict=True)}


def fixed_work() -> None:
    """Decompose, sort and exponentiate the same numbers with NumPy."""
    matrix, values = _numbers()
    np.linalg.qr(matrix)
    np.sort(values)
    np.exp(values)


@cache
def _numbers() -> tuple[Floats, Floats]:
    rng = np.random.default_rng(0)
    return rng.standard_normal((1000, 60)), rng.standard_normal(100_000)


def of_usual_core(seconds: float) -> float:
    """Processor time as it were on a core that does the fixed work in 2.3 ms."""
    return seconds * USUAL_SECONDS / medians({"": fixed_work}, 9)[0]


def in_words(seconds: float) -> str:
    """Write a duration with three digits and its unit."""
    factor, unit = (1.0, "s") if seconds >= 1 else (1e3, "ms") if seconds >= 1e-3 else (1e6, "us")
    return f"{seconds * factor:.3g} {unit}"


def _repeats(call: Callable[[], object]) -> int:
    """Find how often to call a short one in 20 ms: the first meets memory that others filled."""
    call()
    start = time.perf_counter()
    call()
    return max(1, int(0.02 / max(1e-9, time.perf_counter() - start)))
