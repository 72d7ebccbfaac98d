"""Where the project lies, and the real sequences beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[2]

DATA: Final = ROOT.parent / "shared" / "data"
"""Absent on most machines: tests that read it skip then."""
