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
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

# One thread each: experiments run side by side.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from experiments import BLOCKS, Experiment, Row, experiments  # noqa: E402 (after the threads)

KEPT: Final = Path(__file__).with_name("truth.toml")
N_PROCESSES: Final = 2
OPTIONAL: Final = ("seeds", "recorded")
# What is equal but for last digits, of another machine or of what is kept.
_ROUNDING: Final = 1e-3


@dataclass(frozen=True)
class Kept:
    """What truth.toml has of a row.

    Parameters
    ----------
    value : float
    tolerance : float
        By how much a value may be worse: two standard errors, at most a third of the way to the
        goal.
    standard_error : float
        Over fresh seeds; 0 of a figure without chance.
    seeds : int
        How many.
    recorded : str
        The day on which a row that no table measures was measured by hand.
    """

    value: float
    tolerance: float
    standard_error: float = 0.0
    seeds: int = 0
    recorded: str = ""


@dataclass(frozen=True)
class Line:
    """A row of the table as printed: what was measured beside what is kept."""

    row: Row
    kept: Kept | None
    value: float | None
    trouble: str = ""

    @property
    def verdict(self) -> str:
        """Worse, better or same; FAILED where it could not be measured."""
        if self.value is None:
            return "FAILED" if not self.trouble.startswith("skipped") else "skipped"
        if self.kept is None:
            return "new"
        change = self.row.shortfall(self.value) - self.row.shortfall(self.kept.value)
        slack = self.kept.tolerance + _ROUNDING * abs(self.kept.value)
        if not change <= slack:
            return "WORSE"
        return "better" if change < -slack else "same"

    @property
    def fails(self) -> bool:
        """Whether the table fails by it."""
        return self.verdict in ("WORSE", "FAILED", "new")


def main() -> int:
    """Measure, print, keep; 1 where a row is worse than its tolerance or was not measured."""
    options = _options()
    chosen = experiments(options.quick, tuple(options.only))
    if options.markdown:
        sys.stdout.write(markdown(read_kept()))
        return 0
    seconds = time.perf_counter()
    lines: list[Line] = []
    kept = read_kept()
    for each, measured in _measured(chosen, 0):
        lines += _lines(each, measured, kept)
    order = {row.name: place for place, row in enumerate(_rows(chosen))}
    lines.sort(key=lambda line: order[line.row.name])
    if options.keep:
        _keep(lines, _errors(chosen, options.seeds))
        kept = read_kept()
        lines = [
            Line(line.row, kept.get(line.row.name), line.value, line.trouble) for line in lines
        ]
    if options.json:
        print(json.dumps([_record(line) for line in lines], indent=1))
    else:
        print(table(lines))
        print(_summary(lines, time.perf_counter() - seconds))
    return int(any(line.fails for line in lines))


def table(lines: list[Line]) -> str:
    """Lay the table out for a terminal, block by block."""
    cells = [("row", "now", "kept", "+-", "goal", ""), *(_cells(line) for line in lines)]
    widths = [max(len(row[i]) for row in cells) for i in range(6)]
    texts = []
    block = ""
    for line, row in zip([None, *lines], cells, strict=True):
        if line and line.row.name.split(".")[0] != block:
            block = line.row.name.split(".")[0]
            texts += ["", block]
        text = "  ".join(
            [row[0].ljust(widths[0]), *(row[i].rjust(widths[i]) for i in range(1, 5)), row[5]]
        )
        texts.append(text.rstrip())
    return "\n".join(texts)


def markdown(kept: Mapping[str, Kept]) -> str:
    """Write docs/truth.md: the kept values, each with what it is."""
    texts = [
        "# What users get, in figures",
        "",
        "Written by `make truth MARKDOWN=1` from `benchmarks/truth.toml`; `make truth` measures",
        "each row again and fails where one is worse than its tolerance. A tolerance is two",
        "standard errors over fresh seeds, at most a third of the way to the goal. **Short** marks",
        "rows that do not reach their goal yet. Rows on real recordings are measured where these",
        "are at hand.",
    ]
    rows = list(_rows(experiments()))
    for block in BLOCKS:
        texts += ["", f"## {block.capitalize()}", "", "| figure | value | tolerance | goal | |"]
        texts.append("|---|---|---|---|---|")
        for row in rows:
            if row.name.split(".")[0] == block and (stored := kept.get(row.name)):
                short = "**short**" if row.is_short(stored.value) else ""
                value = f"{_number(stored.value)} {row.unit}".strip()
                spread = f"{_number(stored.tolerance)}"
                what = row.what.replace("|", r"\|")
                texts.append(f"| {what} | {value} | {spread} | {_goal(row)} | {short} |")
    return "\n".join(texts) + "\n"


def read_kept() -> dict[str, Kept]:
    """Read truth.toml."""
    if not KEPT.is_file():
        return {}
    content = tomllib.loads(KEPT.read_text())
    return {name: Kept(**values) for name, values in content.items()}


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--quick", action="store_true", help="the quick part, 90 s at most")
    parser.add_argument("--only", nargs="+", default=[], help="rows whose names begin so")
    parser.add_argument("--json", action="store_true")
    parser.add_argument(
        "--markdown", action="store_true", help="the kept values, for docs/truth.md"
    )
    parser.add_argument("--keep", action="store_true", help="move the kept values to those of now")
    parser.add_argument(
        "--seeds", type=int, default=0, help="fresh seeds to derive tolerances from"
    )
    return parser.parse_args()


def _measured(
    chosen: list[Experiment], seed: int
) -> Iterator[tuple[Experiment, dict[str, float] | str]]:
    """Measure: two side by side, then one by one what is timed."""
    side_by_side = [each for each in chosen if not each.is_timed]
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(N_PROCESSES, spawn) as pool:
        waiting = {pool.submit(_measure, each.rows[0].name, seed): each for each in side_by_side}
        for done in as_completed(waiting):
            yield waiting[done], _told(waiting[done], *done.result())
    for each in chosen:
        if each.is_timed:
            with ProcessPoolExecutor(1, spawn) as pool:
                result = pool.submit(_measure, each.rows[0].name, seed).result()
            yield each, _told(each, *result)


def _told(
    each: Experiment, measured: dict[str, float] | str, seconds: float
) -> dict[str, float] | str:
    print(f"{seconds:6.1f} s  {each.rows[0].name}", file=sys.stderr, flush=True)
    return measured


def _measure(name: str, seed: int) -> tuple[dict[str, float] | str, float]:
    from real_data import is_there

    each = next(each for each in experiments() if each.rows[0].name == name)
    if not is_there(each.rows[0].name, *each.needs):
        return f"skipped: {', '.join(each.needs)} not there", 0.0
    start = time.perf_counter()
    try:
        return each.values(seed), time.perf_counter() - start
    except Exception as error:  # noqa: BLE001 (a row that cannot be measured is a result)
        return f"{type(error).__name__}: {error}", time.perf_counter() - start


def _lines(
    each: Experiment, measured: dict[str, float] | str, kept: Mapping[str, Kept]
) -> list[Line]:
    if isinstance(measured, str):
        return [Line(row, kept.get(row.name), None, measured) for row in each.rows]
    return [Line(row, kept.get(row.name), measured[row.name]) for row in each.rows]


def _errors(chosen: list[Experiment], n_seeds: int) -> dict[str, tuple[float, int]]:
    """Measure each row with fresh seeds: its standard error, and over how many."""
    values: dict[str, list[float]] = {}
    for seed in range(1, n_seeds + 1):
        for _, measured in _measured(chosen, seed):
            if not isinstance(measured, str):
                for name, value in measured.items():
                    values.setdefault(name, []).append(value)
    return {
        name: (statistics.stdev(of_row), len(of_row))
        for name, of_row in values.items()
        if len(of_row) > 1
    }


def _keep(lines: list[Line], errors: Mapping[str, tuple[float, int]]) -> None:
    """Write the values of now, under a lock, in the order of the table."""
    with KEPT.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        kept = read_kept()
        for line in lines:
            if line.value is not None:
                kept[line.row.name] = kept_of(line, errors.get(line.row.name))
        places = {row.name: place for place, row in enumerate(_rows(experiments()))}
        # Rows that came while this ran are kept too, after the others.
        names = sorted(kept, key=lambda name: places.get(name, len(places)))
        KEPT.write_text("\n".join(_toml(name, kept[name]) for name in names))


def kept_of(line: Line, error: tuple[float, int] | None) -> Kept:
    assert line.value is not None
    value = float(f"{line.value:.6g}")
    if line.row.tolerance is not None:
        return Kept(value, line.row.tolerance, recorded=line.kept.recorded if line.kept else "")
    spread, n_seeds = error or (
        (line.kept.standard_error, line.kept.seeds) if line.kept else (0, 0)
    )
    # Exactly at its goal a figure has no way to go: its own spread is all that there is.
    way = line.row.way_to_goal(value) or math.inf
    tolerance = min(2 * spread, way / 3)
    return Kept(value, float(f"{tolerance:.2g}"), float(f"{spread:.2g}"), n_seeds)


def _toml(name: str, kept: Kept) -> str:
    values = {key: value for key, value in asdict(kept).items() if value or key not in OPTIONAL}
    return "\n".join([f'["{name}"]', *(f"{key} = {value!r}" for key, value in values.items()), ""])


def _rows(chosen: list[Experiment]) -> Iterator[Row]:
    for each in chosen:
        yield from each.rows


def _cells(line: Line) -> tuple[str, ...]:
    kept = line.kept
    short = "short" if line.value is not None and line.row.is_short(line.value) else ""
    return (
        f"  {line.row.name}",
        f"{_number(line.value)} {line.row.unit}".strip() if line.value is not None else "",
        _number(kept.value) if kept else "",
        _number(kept.tolerance) if kept else "",
        _goal(line.row),
        " ".join(filter(None, (line.verdict, short, line.trouble))),
    )


def _record(line: Line) -> dict[str, object]:
    return {
        "row": line.row.name,
        "what": line.row.what,
        "unit": line.row.unit,
        "now": line.value,
        "kept": line.kept and asdict(line.kept),
        "goal": line.row.goal,
        "verdict": line.verdict,
        "short": line.value is not None and line.row.is_short(line.value),
        "trouble": line.trouble,
    }


def _summary(lines: list[Line], seconds: float) -> str:
    count = dict.fromkeys(("same", "better", "WORSE", "FAILED", "new", "skipped"), 0)
    for line in lines:
        count[line.verdict] += 1
    n_short = sum(line.value is not None and line.row.is_short(line.value) for line in lines)
    found = ", ".join(f"{n} {verdict}" for verdict, n in count.items() if n)
    return f"\n{len(lines)} rows in {seconds:.0f} s: {found}; {n_short} short of their goal"


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
