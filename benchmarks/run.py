"""Run the benchmarks beside the table of truth: peers, and the trade of modes."""

from __future__ import annotations

import importlib
import sys

from real_data import told

MODULES = ("tradeoff", "codec", "tracking_peers", "classification")  # each with run() -> tables


def main(names: list[str]) -> None:
    """Run the named benchmarks, or all."""
    for name in names or MODULES:
        for table in importlib.import_module(name).run():
            print(table, end="\n\n", flush=True)
    print(told())


if __name__ == "__main__":
    main(sys.argv[1:])
