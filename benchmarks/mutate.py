"""Which rows of the table of truth notice that the product is broken.

Each file of mutants/ is a patch of a few lines with a heading:

    what: Peaks of the posterior are not squared.
    rows: fit.noise.ratio fit.auto.excess
    lives: why it may live for now, if it may

A mutant is caught where each row it names is worse than its tolerance.

    python benchmarks/mutate.py              all mutants
    python benchmarks/mutate.py --only fit   those whose file names begin so
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from real_data import ENVIRONMENT, ROOT

WITHOUT: Final = ("weight", "use")  # blocks whose rows need no mutant: they count and time


@dataclass(frozen=True)
class Mutant:
    """A patch, and the rows that must notice it."""

    path: Path
    what: str
    rows: tuple[str, ...]
    lives: str

    @classmethod
    def read(cls, path: Path) -> Mutant:
        """Read the heading of a patch."""
        heading = path.read_text().split("\ndiff ")[0].splitlines()
        said = dict(line.split(": ", 1) for line in heading if ": " in line)
        return cls(path, said["what"], tuple(said["rows"].split()), said.get("lives", ""))

    def unnoticed(self) -> list[str]:
        """Run its rows on a patched copy; those that are no worse than their tolerance."""
        with tempfile.TemporaryDirectory() as place:
            copy = Path(place) / "project"
            without = shutil.ignore_patterns(".*", "node_modules", "__pycache__")
            shutil.copytree(ROOT, copy, ignore=without)
            subprocess.run(["git", "apply", str(self.path)], cwd=copy, check=True)
            paths = os.pathsep.join(str(copy / part) for part in ("core", "service"))
            environment = os.environ | ENVIRONMENT | {"PYTHONPATH": paths}
            command = [sys.executable, "benchmarks/truth.py", "--json", "--only", *self.rows]
            run = subprocess.run(
                command, cwd=copy, env=environment, capture_output=True, text=True, check=False
            )
        verdicts = {line["row"]["name"]: line["verdict"] for line in json.loads(run.stdout)}
        found = {row: verdicts.get(row, "no such row") for row in self.rows}
        noticed = ("WORSE", "skipped")
        return [f"{row} ({said})" for row, said in found.items() if said not in noticed]


def main() -> int:
    """Run the mutants; 1 where one lives that may not."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--only", nargs="+", default=[""], help="files whose names begin so")
    only = tuple(parser.parse_args().only)
    mutants = [Mutant.read(path) for path in sorted(Path(__file__).parent.glob("mutants/*.patch"))]
    chosen = [each for each in mutants if each.path.name.startswith(only)]
    # One for each core: each runs processes of its own, of one thread.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return int(any(list(pool.map(_lives_unasked, chosen))))  # all: any alone stops at one


def _lives_unasked(mutant: Mutant) -> bool:
    """Print whether a mutant is caught; true where it lives and may not."""
    start, verdict = time.perf_counter(), "caught"
    if unnoticed := mutant.unnoticed():
        verdict = f"LIVES, unnoticed by {', '.join(unnoticed)}"
        verdict += f"; may live: {mutant.lives}" if mutant.lives else ""
    seconds = time.perf_counter() - start
    print(f"{seconds:6.1f} s  {mutant.path.stem}: {verdict}", flush=True)
    return bool(unnoticed) and not mutant.lives


if __name__ == "__main__":
    sys.exit(main())
