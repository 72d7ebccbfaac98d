"""Real recordings beside the project, by their names; what is skipped without them is told."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

from modalmotion.formats import read_npz
from modalmotion.mesh.sequence import MeshSequence

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from project import DATA as DATA

ENVIRONMENT: Final = {"MODALMOTION_DATA": str(DATA)}
"""Where a copy of the project finds the same recordings."""

SKIPPED: Final[list[str]] = []
"""Figures that were not measured, for want of their recordings."""


def is_there(figures: str, *names: str) -> bool:
    """Tell whether recordings are there; if not, the figures count as skipped.

    Parameters
    ----------
    figures : str
        Which bench, and what it measures on them.
    *names : str
        Files without their suffix .npz, or folders.
    """
    absent = [name for name in names if not _path(name).is_file() and not (DATA / name).is_dir()]
    if absent:
        SKIPPED.append(f"{figures} ({', '.join(absent)})")
    return not absent


def recording(name: str) -> MeshSequence:
    """Read a recording, such as heart/lv_endocardium."""
    return read_npz(_path(name).read_bytes()).sequence


def files_of(folder: str) -> list[Path]:
    """List the recordings of a folder by name."""
    return sorted((DATA / folder).glob("*.npz"))


def told() -> str:
    """Say what was skipped; empty where nothing was."""
    head = f"skipped, for its data are not in {DATA} (MODALMOTION_DATA names another folder):"
    return "\n  ".join([head, *SKIPPED]) if SKIPPED else ""


def _path(name: str) -> Path:
    return DATA / f"{name}.npz"
