"""Write docs/extremes.md: each numerical extreme, the right answer and the error reached."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]

SECTIONS = (
    ("Basis, eigenvalues and projection on lattices", "extremes_lattice_rows"),
    ("Oscillators", "extremes_oscillator_rows"),
)
"""Titles, and the modules of tests/core whose ROWS are held to their bounds by the tests."""

HEAD = """# Numerical extremes

Written by `python benchmarks/extremes.py` from a run of the rows that
`tests/extremes/test_rows.py` holds to their bounds. "Straightforward" is the error of the formula
that suggests itself, where it was computed too. The last digits depend on the machine.
"""


def main() -> None:
    """Evaluate every row and write the table."""
    parts = [HEAD]
    for title, module in SECTIONS:
        parts += [f"\n## {title}\n", *table(rows_of(module))]
    path = ROOT / "docs" / "extremes.md"
    path.write_text("\n".join(parts) + "\n", encoding="utf-8")
    print(f"{path.relative_to(ROOT)} written")


def rows_of(module: str) -> Sequence[tuple[Any, ...]]:
    """Rows of one module of the tests: name, right answer, error reached, bound, ..."""
    for folder in ("extremes", "slow_twins", "support"):
        if (path := str(ROOT / "tests" / folder)) not in sys.path:
            sys.path.append(path)
    rows: Sequence[tuple[Any, ...]] = importlib.import_module(module).ROWS
    return rows


def table(rows: Sequence[tuple[Any, ...]]) -> list[str]:
    """Lines of a table of rows; its last column only where a row has a straightforward formula."""
    has_naive = any(len(row) > 4 for row in rows)
    head = ["extreme", "right answer", "error reached", "bound"]
    head += ["straightforward"] * has_naive
    lines = [_line(head), _line(["---"] * len(head))]
    for extreme, right, reached, bound, *naive in rows:
        error = reached()
        assert error <= bound, f"{extreme}: {error} > {bound}"
        cells = [extreme, right, _number(error), _number(bound)]
        if has_naive:
            cells.append(_of(naive[0]) if naive else "")
        lines.append(_line(cells))
    return lines


def _of(naive: Callable[[], float] | None) -> str:
    return "" if naive is None else f"**{_number(naive())}**"


def _number(value: float) -> str:
    return f"{value:.3g}" if value >= 1 else f"{value:.2g}"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


if __name__ == "__main__":
    main()
