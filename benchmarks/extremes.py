"""Write docs/extremes.md: each numerical extreme, the right answer and the error reached."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from measure import table

ROOT = Path(__file__).resolve().parents[1]

SECTIONS = (
    ("Basis, eigenvalues and projection on lattices", "extremes_lattice_rows"),
    ("Oscillators", "extremes_oscillator_rows"),
)
"""Titles, and the modules of tests/core whose ROWS are held to their bounds by the tests."""

HEAD = """# Numerical extremes

Written by `python benchmarks/extremes.py` from a run of the rows that
`tests/extremes/test_rows.py` holds to their bounds. "Straightforward" is the error of the formula
that suggests itself, where it was computed too. The last digits depend on the machine."""
COLUMNS = ("extreme", "right answer", "error reached", "bound", "straightforward")
Number = Callable[[], float]


def main() -> None:
    """Evaluate every row and write the table."""
    parts = [HEAD]
    for title, module in SECTIONS:
        parts.append(table(title, COLUMNS, [cells_of(*row) for row in rows_of(module)]))
    path = ROOT / "docs" / "extremes.md"
    path.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    print(f"{path.relative_to(ROOT)} written")


def rows_of(module: str) -> Sequence[tuple[Any, ...]]:
    """Rows of one module of the tests: name, right answer, error reached, bound, ..."""
    for folder in ("extremes", "slow_twins", "support"):
        if (path := str(ROOT / "tests" / folder)) not in sys.path:
            sys.path.append(path)
    rows: Sequence[tuple[Any, ...]] = importlib.import_module(module).ROWS
    return rows


def cells_of(
    extreme: str, right: str, reached: Number, bound: float, naive: Number | None = None
) -> list[str]:
    """Evaluate a row; its last cell is the error of the straightforward formula, if it has one."""
    error = reached()
    assert error <= bound, f"{extreme}: {error} > {bound}"
    other = "" if naive is None else f"**{naive():.2g}**"
    return [
        extreme.replace("|", r"\|"),
        right.replace("|", r"\|"),
        f"{error:.2g}",
        f"{bound:.2g}",
        other,
    ]


if __name__ == "__main__":
    main()
