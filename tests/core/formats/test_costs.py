"""Small files made to keep a reader busy: each is read or refused in a moment."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest
from costly_files import COSTLY
from project import ROOT

SHORT = (
    *("glb of one mesh", "glb chain with leaves", "glb zeros", "vtp attributes", "vtp arrays"),
    *("vtk fields", "hdf5 groups", "zip of one line, frames", "zip listed again", "stl solids"),
)
# Of processor time. What was to be mended took from five seconds to five minutes.
MOST_SECONDS = 2.0


def costs(folder: Path, names: Iterable[str]) -> dict[str, tuple[str, float]]:
    """What became of each file, and what it cost."""
    for name in names:
        (folder / name).write_bytes(COSTLY[name]())
    program = ROOT / "tests" / "support" / "reading_costs.py"
    run = subprocess.run(
        [sys.executable, str(program), *(str(folder / name) for name in names)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr[-2000:]
    rows = [line.split("\t") for line in run.stdout.splitlines()]
    return {name: (outcome, float(seconds)) for name, outcome, seconds in rows}


def require_moments(folder: Path, names: Iterable[str]) -> None:
    for name, (outcome, seconds) in costs(folder, names).items():
        assert outcome in ("read", "refused"), name
        assert seconds < MOST_SECONDS, name


@pytest.mark.thorough
def test_a_small_file_costs_a_moment(tmp_path: Path) -> None:
    require_moments(tmp_path, SHORT)


@pytest.mark.soak
def test_no_small_file_costs_more_than_a_moment(tmp_path: Path) -> None:
    require_moments(tmp_path, COSTLY)
