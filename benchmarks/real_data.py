"""Real recordings beside the project, by name; and the folders of what the tests are made of."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

from modalmotion.formats import read_npz
from modalmotion.mesh.sequence import MeshSequence

sys.path.extend(
    str(Path(__file__).resolve().parents[1] / folder)
    for folder in ("tests/support", "tests/slow_twins", "tests/extremes", "tools")
)

from project import DATA as DATA
from project import ROOT as ROOT

# Where a copy of the project finds the same recordings.
ENVIRONMENT: Final = {"MODALMOTION_DATA": str(DATA)}
# Figures that were not measured, for want of their recordings.
SKIPPED: Final[list[str]] = []


def is_there(figures: str, *names: str) -> bool:
    """Return whether recordings, files without .npz or folders, exist; note what is skipped."""
    absent = [x for x in names if not ((DATA / f"{x}.npz").is_file() or (DATA / x).is_dir())]
    if absent:
        SKIPPED.append(f"{figures} ({', '.join(absent)})")
    return not absent


def recording(name: str) -> MeshSequence:
    """Read a recording, such as heart/lv_endocardium."""
    return read_npz((DATA / f"{name}.npz").read_bytes()).sequence


def told() -> str:
    """List what was skipped; empty if nothing was."""
    head = f"skipped, for its data are not in {DATA} (MODALMOTION_DATA names another folder):"
    return "\n  ".join([head, *SKIPPED]) if SKIPPED else ""
