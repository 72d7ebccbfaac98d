"""Run the benchmarks beside the table of truth: peers on the screen, plots in bench-output/."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

from real_data import told

MODULES = (
    "tradeoff",
    "codec",
    "tracking_peers",
    "image_peers",
    "classification",
)
"""Modules of this folder, each with `run(folder) -> list[Table]`."""


def main(names: list[str]) -> int:
    """Run the named benchmarks, or all; the number of missed bounds."""
    folder = Path(__file__).resolve().parents[1] / "bench-output"
    folder.mkdir(exist_ok=True)
    n_missed = 0
    for name in names or MODULES:
        for table in importlib.import_module(name).run(folder):
            print(table, end="\n\n", flush=True)
            n_missed += table.n_missed
    print(f"plots in {folder.name}/; {n_missed} bounds missed")
    if skipped := told():
        print(skipped)
    return n_missed


if __name__ == "__main__":
    sys.exit(min(1, main(sys.argv[1:])))
