"""The table of truth: what users get, beside what is kept in truth.toml, with its tolerance.

    python benchmarks/truth.py                  the whole table
    python benchmarks/truth.py --quick          its quick part
    python benchmarks/truth.py --only fit       rows whose names begin so
    python benchmarks/truth.py --only fit --keep --seeds 5

The last form moves the kept values on purpose, and derives the tolerances from five fresh seeds.
"""

from __future__ import annotations

import argparse
import fcntl
import json
import math
import multiprocessing
import os
import statistics
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

# One thread each: experiments run side by side.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from experiments import BLOCKS, Experiment, Row, experiments  # noqa: E402 (after the threads)
from real_data import is_there  # noqa: E402

KEPT: Final = Path(__file__).with_name("truth.toml")
N_PROCESSES: Final = 2
_ROUNDING: Final = 1e-3  # last digits, of another machine or of what is kept
_LOAD: Final = 0.25  # of a time: what a busy machine moved the ratios and shares by, at most 0.21


@dataclass(frozen=True)
class Kept:
    """What truth.toml has of a row."""

    value: float
    tolerance: float  # two standard errors, at most a third of the way to the goal
    standard_error: float = 0.0  # over fresh seeds; 0 of a figure without chance
    seeds: int = 0
    recorded: str = ""  # the day on which a row that no table measures was measured by hand


@dataclass(frozen=True)
class Line:
    """A row of the table as printed: what was measured beside what is kept."""

    row: Row
    kept: Kept | None
    value: float | None
    trouble: str = ""
    is_timed: bool = False

    @property
    def verdict(self) -> str:
        """Worse, better or same; FAILED where it could not be measured."""
        if self.value is None:
            return "FAILED" if not self.trouble.startswith("skipped") else "skipped"
        if self.kept is None:
            return "new"
        change = self.row.shortfall(self.value) - self.row.shortfall(self.kept.value)
        slack = self.kept.tolerance
        slack += (_LOAD if self.is_timed else _ROUNDING) * abs(self.kept.value)
        if not change <= slack:
            return "WORSE"
        return "better" if change < -slack else "same"

    @property
    def fails(self) -> bool:
        """Whether the table fails by it."""
        return self.verdict in ("WORSE", "FAILED", "new")

    @property
    def is_short(self) -> bool:
        """Whether it was measured and falls short of its goal."""
        return self.value is not None and self.row.is_short(self.value)


def main() -> int:
    """Measure, print, keep; 1 where a row is worse than its tolerance or was not measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--quick", action="store_true", help="the quick part, 90 s at most")
    parser.add_argument("--only", nargs="+", default=[""], help="rows whose names begin so")
    parser.add_argument("--json", action="store_true", help="lines as JSON")
    parser.add_argument("--markdown", action="store_true", help="kept values, for docs/truth.md")
    parser.add_argument("--keep", action="store_true", help="move the kept values to those of now")
    parser.add_argument("--seeds", type=int, default=0, help="fresh ones, to derive tolerances")
    options = parser.parse_args()
    if options.markdown:
        sys.stdout.write(markdown(read_kept()))
        return 0
    start = time.perf_counter()
    chosen = experiments(options.quick, tuple(options.only))
    lines = measured(chosen, 0)
    if options.keep:
        others = [measured(chosen, seed) for seed in range(1, options.seeds + 1)]
        kept = _keep(lines, others)
        lines = [replace(line, kept=kept.get(line.row.name)) for line in lines]
    if options.json:
        print(json.dumps([asdict(line) | {"verdict": line.verdict} for line in lines], indent=1))
    else:
        print(table(lines))
        counts = Counter(line.verdict for line in lines)
        found = ", ".join(f"{n} {verdict}" for verdict, n in counts.items())
        n_short = sum(line.is_short for line in lines)
        seconds = time.perf_counter() - start
        print(f"\n{len(lines)} rows in {seconds:.0f} s: {found}; {n_short} short of their goal")
    return int(any(line.fails for line in lines))


def table(lines: list[Line]) -> str:
    """Lay the table out for a terminal."""
    cells = [("row", "now", "kept", "+-", "goal", ""), *map(_cells, lines)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    aligned = zip("<>>>><", widths, strict=True)
    layout = "  ".join(f"{{:{side}{width}}}" for side, width in aligned)
    return "\n".join(layout.format(*row).rstrip() for row in cells)


def markdown(kept: Mapping[str, Kept]) -> str:
    """Write docs/truth.md: the kept values, each with what it is."""
    texts = [
        "# What users get, in figures",
        "",
        "Written by `make truth MARKDOWN=1` from `benchmarks/truth.toml`; `make truth` measures",
        "each row again and fails where one is worse than its tolerance. A tolerance is two",
        "standard errors over fresh seeds, at most a third of the way to the goal; times may also",
        f"be {100 * _LOAD:.0f} % longer, as on a busy machine. **Short** marks rows that do not",
        "reach their goal yet. Rows on real recordings are measured where these are at hand.",
    ]
    rows = [row for each in experiments() for row in each.rows if row.name in kept]
    for block in BLOCKS:
        texts += ["", f"## {block.capitalize()}", "", "| figure | value | tolerance | goal | |"]
        texts.append("|---|---|---|---|---|")
        for row in rows:
            if row.name.startswith(f"{block}."):
                stored = kept[row.name]
                short = "**short**" if row.is_short(stored.value) else ""
                value = f"{_number(stored.value)} {row.unit}".strip()
                cells = (value, _number(stored.tolerance), _goal(row), short)
                texts.append(" | ".join(["| " + row.what.replace("|", r"\|"), *cells]) + " |")
    return "\n".join(texts) + "\n"


def read_kept() -> dict[str, Kept]:
    """Read truth.toml."""
    return {name: Kept(**values) for name, values in tomllib.loads(KEPT.read_text()).items()}


def measured(chosen: list[Experiment], seed: int) -> list[Line]:
    """Measure: two side by side, then one by one, each in a new process, what is timed."""
    found: dict[str, tuple[dict[str, float], str]] = {}
    spawn = multiprocessing.get_context("spawn")
    for is_timed, n_processes, n_tasks in ((False, N_PROCESSES, None), (True, 1, 1)):
        names = [each.rows[0].name for each in chosen if each.is_timed == is_timed]
        with ProcessPoolExecutor(n_processes, spawn, max_tasks_per_child=n_tasks) as pool:
            found |= zip(names, pool.map(partial(_measure, seed=seed), names), strict=True)
    kept = read_kept()
    return [
        Line(row, kept.get(row.name), values.get(row.name), trouble, each.is_timed)
        for each in chosen
        for values, trouble in [found[each.rows[0].name]]
        for row in each.rows
    ]


def _measure(name: str, seed: int) -> tuple[dict[str, float], str]:
    """Values by row, and what went wrong."""
    each = next(each for each in experiments() if each.rows[0].name == name)
    if not is_there(name, *each.needs):
        return {}, f"skipped: {', '.join(each.needs)} not there"
    start = time.perf_counter()
    try:
        return each.values(seed), ""
    except Exception as error:  # noqa: BLE001 (a row that cannot be measured is a result)
        return {}, f"{type(error).__name__}: {error}"
    finally:
        print(f"{time.perf_counter() - start:6.1f} s  {name}", file=sys.stderr, flush=True)


def _keep(lines: list[Line], others: list[list[Line]]) -> dict[str, Kept]:
    """Write the values of now, in the order of the table; the others are of fresh seeds."""
    with KEPT.open("r+") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        kept = read_kept()
        for line, *fresh in zip(lines, *others, strict=True):
            values = [one.value for one in fresh if one.value is not None]
            error = (statistics.stdev(values), len(values)) if len(values) > 1 else None
            if line.value is not None:
                kept[line.row.name] = kept_of(line, error)
        names = [row.name for each in experiments() for row in each.rows if row.name in kept]
        kept = {name: kept[name] for name in dict.fromkeys([*names, *kept])}
        file.write("\n".join(_toml(name, each) for name, each in kept.items()))
        file.truncate()
    return kept


def kept_of(line: Line, error: tuple[float, int] | None) -> Kept:
    """Round the value of now; its tolerance by its standard error over so many fresh seeds."""
    assert line.value is not None
    value = float(f"{line.value:.6g}")
    before = line.kept or Kept(value, 0.0)
    if line.row.tolerance is not None:
        return Kept(value, line.row.tolerance, recorded=before.recorded)
    spread, n_seeds = error or (before.standard_error, before.seeds)
    # Exactly at its goal a figure has no way to go: its own spread is all that there is.
    way = line.row.way_to_goal(value) or math.inf
    tolerance = min(2 * spread, way / 3)
    return Kept(value, float(f"{tolerance:.2g}"), float(f"{spread:.2g}"), n_seeds)


def _toml(name: str, kept: Kept) -> str:
    required = ("value", "tolerance", "standard_error")
    values = {key: value for key, value in asdict(kept).items() if value or key in required}
    return "\n".join([f'["{name}"]', *(f"{key} = {value!r}" for key, value in values.items()), ""])


def _cells(line: Line) -> tuple[str, ...]:
    kept, remarks = line.kept, (line.verdict, "short" if line.is_short else "", line.trouble)
    return (
        line.row.name,
        f"{_number(line.value)} {line.row.unit}".strip() if line.value is not None else "",
        _number(kept.value) if kept else "",
        _number(kept.tolerance) if kept else "",
        _goal(line.row),
        " ".join(filter(None, remarks)),
    )


def _goal(row: Row) -> str:
    if row.goal is None:
        return ""
    if isinstance(row.goal, tuple):
        return f"{_number(row.goal[0])} to {_number(row.goal[1])}"
    return f"{'<=' if row.better == 'lower' else '>='} {_number(row.goal)}"


def _number(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 10_000 else f"{value:.4g}"


if __name__ == "__main__":
    sys.exit(main())
