"""What the table of truth measures: experiments, each giving the values of its rows."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, Literal, TypeAlias

# In the order of the table; the experiments of each block are in rows_<block>.py.
BLOCKS: Final = (
    *("mission", "modes", "fit", "readouts", "tracking", "images"),
    *("classes", "codec", "service", "use", "weight"),
)
# From a seed, 0 for the table's own, to one value for each row.
Measure: TypeAlias = Callable[[int], float | tuple[float, ...]]


@dataclass(frozen=True)
class Row:
    """One figure of the table."""

    name: str  # block.what.which
    what: str  # what the figure is, for a reader who has never seen it
    unit: str = ""
    goal: float | tuple[float, float] | None = None  # a bound, or a range that it should lie in
    better: Literal["lower", "higher"] = "lower"  # where the goal is no range
    tolerance: float | None = None  # of a figure without chance, which has no standard error

    def shortfall(self, value: float) -> float:
        """Measure how far a value is from what is wished for; 0 within the range of a goal."""
        if isinstance(self.goal, tuple):
            return max(self.goal[0] - value, value - self.goal[1], 0.0)
        return value if self.better == "lower" else -value

    def is_short(self, value: float) -> bool:
        """Return whether a value falls short of its goal."""
        if self.goal is None:
            return False
        bound = 0.0 if isinstance(self.goal, tuple) else self.shortfall(self.goal)
        return not self.shortfall(value) <= bound

    def way_to_goal(self, value: float) -> float:
        """Measure how far a value is from the nearest bound of its goal, on either side of it."""
        if self.goal is None:
            return float("inf")
        bounds = self.goal if isinstance(self.goal, tuple) else (self.goal,)
        return min(abs(value - bound) for bound in bounds)


def rows(keys: Iterable[object], name: str, what: str, unit: str = "", **options: Any) -> list[Row]:
    """Make rows that differ by one word each, which stands for {} in names and texts."""
    return [Row(name.format(key), what.format(key), unit, **options) for key in keys]


@dataclass(frozen=True)
class Experiment:
    """One measurement of rows, in their order."""

    rows: tuple[Row, ...]
    measure: Measure
    quick: bool  # part of the quick table
    needs: tuple[str, ...]  # recordings beside the project without which it is skipped
    is_timed: bool  # run by itself, after all others

    def values(self, seed: int) -> dict[str, float]:
        """Measure, and name the values by row."""
        measured = self.measure(seed)
        values = measured if isinstance(measured, tuple) else (measured,)
        pairs = zip(self.rows, values, strict=True)
        return {row.name: float(value) for row, value in pairs}


# All experiments of the modules imported so far, in order.
REGISTERED: Final[list[Experiment]] = []


def experiment(
    *rows: Row, quick: bool = False, needs: tuple[str, ...] = (), is_timed: bool = False
) -> Callable[[Measure], Measure]:
    """Register a function that measures rows."""

    def register(measure: Measure) -> Measure:
        REGISTERED.append(Experiment(rows, measure, quick, needs, is_timed))
        return measure

    return register


quick = partial(experiment, quick=True)
timed = partial(experiment, is_timed=True)


def experiments(is_quick: bool = False, only: tuple[str, ...] = ("",)) -> list[Experiment]:
    """List experiments: all, those of the quick table, those with rows that begin as named.

    The quick table has no times: it runs beside whatever else a machine does.
    """
    for block in BLOCKS:
        importlib.import_module(f"rows_{block}")
    chosen = [each for each in REGISTERED if each.quick or not is_quick]
    return [each for each in chosen if any(row.name.startswith(only) for row in each.rows)]
