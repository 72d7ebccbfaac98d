"""Write docs/extremes.md: each numerical extreme, the right answer and the error reached."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from measure import table
from real_data import ROOT

SECTIONS: dict[str, Sequence[tuple[Any, ...]]] = {
    title: import_module(f"extremes_{name}_rows").ROWS
    for title, name in (
        ("Basis, eigenvalues and projection on lattices", "lattice"),
        ("Oscillators", "oscillator"),
    )
}
"""By title: rows of an extreme, its right answer, what gives the error reached, its bound, ..."""

HEAD = """# Numerical extremes

Written by `python benchmarks/extremes.py` from a run of the rows that
`tests/extremes/test_rows.py` holds to their bounds. "Straightforward" is the error of the formula
that suggests itself, where it was computed too. The last digits depend on the machine."""
COLUMNS = ("extreme", "right answer", "error reached", "bound", "straightforward")
Number = Callable[[], float]


def main() -> None:
    """Evaluate every row and write the table."""
    parts = [HEAD]
    parts += [
        table(title, COLUMNS, [cells_of(*row) for row in rows]) for title, rows in SECTIONS.items()
    ]
    path = ROOT / "docs" / "extremes.md"
    path.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    print(f"{path.relative_to(ROOT)} written")


def cells_of(
    extreme: str, right: str, reached: Number, bound: float, naive: Number | None = None
) -> list[str]:
    """Evaluate a row; its last cell is the error of the straightforward formula, if it has one."""
    error = reached()
    assert error <= bound, f"{extreme}: {error} > {bound}"
    other = "" if naive is None else f"**{naive():.2g}**"
    texts = (each.replace("|", r"\|") for each in (extreme, right))
    return [*texts, f"{error:.2g}", f"{bound:.2g}", other]


if __name__ == "__main__":
    main()
